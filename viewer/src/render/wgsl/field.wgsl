// What the device holds of a field, and what is interpolated from it: `field.glsl` in WGSL. `source.ts` declares textures and
// uniforms, each of which is a function (`data.ts`), and says what is defined.

// Optical depth from which a ray ends: transmittance 1e-5.
const OPAQUE_DEPTH = 11.6;
// Positions so little beyond a face lie on it: f32 of an entry is no closer.
const ON_FACE = 1e-6;
const LARGEST = 3e38;

var<private> fetches: i32 = 0;
// The block that was looked up last, and its level, of even and of odd levels; what the table says there. No arrays:
// cards keep those in memory.
var<private> lookedUpEven: vec4i = vec4i(-1);
var<private> lookedUpOdd: vec4i = vec4i(-1);
var<private> placeEven: u32 = 0u;
var<private> placeOdd: u32 = 0u;

// The smallest box that holds what is sampled.
var<private> box: i32 = 0;

fn levelOfPart(part: i32) -> i32 {
#ifdef NESTED
  return select(part - LEVELS + 1, part, part < LEVELS);
#else
  return part;
#endif
}

fn softplus(x: f32) -> f32 {
  return max(x, 0.0) + log(1.0 + exp(-abs(x)));
}

// 1 - exp(-depth), also where that is small.
fn opacity(depth: f32) -> f32 {
  return select(1.0 - exp(-depth), depth * (1.0 - 0.5 * depth), depth < 1e-3);
}

fn opaqueDepth(alpha: f32) -> f32 {
  return -log(1.0 - clamp(alpha, 0.0, 1.0 - 1.1920929e-7));
}

// How a level's densities are decoded.
fn decodeOf(level: i32) -> i32 {
#ifdef DECODE
  return DECODE;
#else
  return u_levels(level).z;
#endif
}

// Optical depth over one interval.
fn opticalDepth(density: f32, decode: i32) -> f32 {
  if (decode == 1) { return min(density * density, LARGEST); }
  if (decode == 2) { return opaqueDepth(density); }
#if ORDER == 0 && defined(RELU)
  return min(max(density, 0.0) * u_activation().y, LARGEST);
#elif ORDER == 0
  return min(softplus(density + u_activation().x) * u_activation().y, LARGEST);
#elif ORDER == 1
  return min(max(density, 0.0) * u_activation().y, LARGEST);
#else
  return opaqueDepth(density);
#endif
}

// In the table: the block is stored, but has no slot.
const ABSENT = 0xffffffffu;
#ifdef PARTIAL
// Whether that holds for a block of the cell that was located last.
var<private> isAbsent: bool = false;
#endif

// The corners of a cell, as `field.glsl` says.
struct Cell { lower: vec4u, upper: vec4u, lowerShares: vec4f, upperShares: vec4f }
// The cell that was located last.
var<private> located: Cell;

// One more than the first texel of a block's slot; 0 where it is not stored.
fn lookUp(level: i32, block: vec3i) -> u32 {
  fetches++;
  return textureLoad(u_table, vec3i(block.zy, block.x + u_levels(level).x), 0).r;
}

// False where the level stores nothing at the position.
fn locate(level: i32, position: vec3f) -> bool {
  let nodes = u_nodes(level).xyz;
  let edge = u_nodes(level).w;
  let at = position * vec3f(nodes - 1);
  let lowest = min(vec3i(at), nodes - 2);
  // Half a node above the lowest one no rounding moves the quotient past a whole number; processors divide whole numbers
  // one by one.
  let block = vec3i((vec3f(lowest) + 0.5) / f32(edge));
  let isOdd = (levelOfPart(level) & 1) == 1;
  var place = select(placeEven, placeOdd, isOdd);
  let wanted = vec4i(block, level);
  if (any(select(lookedUpEven, lookedUpOdd, isOdd) != wanted)) {
    place = lookUp(level, block);
    if (isOdd) {
      lookedUpOdd = wanted;
      placeOdd = place;
    } else {
      lookedUpEven = wanted;
      placeEven = place;
    }
  }
#ifdef PARTIAL
  isAbsent = place == ABSENT;
#endif
  // A dense grid stores everything.
  if (place == 0u && u_skips()) { return false; }
  let low = lowest - block * edge;
  let f = at - vec3f(lowest);
  let g = 1.0 - f;
  let shares = vec4f(g.y, g.y, f.y, f.y) * vec4f(g.z, f.z, g.z, f.z);
  // Along these axes, the cell has nodes of the next blocks.
  let leaves = low == vec3i(edge - 1);
  if (place != 0u && !any(leaves)) {
    let texels = vec4u(0u, 1u, 2048u, 2049u) + (place - 1u + (u32(low.x) << 22u) + (u32(low.y) << 11u) + u32(low.z));
    located = Cell(texels, texels + (1u << 22u), shares * g.x, shares * f.x);
    return true;
  }
  var lower = vec4u(place);
  var upper = lower;
  if (leaves.z) {
    let other = lookUp(level, block + vec3i(0, 0, 1));
    lower = vec4u(place, other, place, other);
    upper = lower;
  }
  if (leaves.y) {
    let other = lookUp(level, block + vec3i(0, 1, 0));
    lower = vec4u(lower.xy, other, other);
    if (leaves.z) { lower.w = lookUp(level, block + vec3i(0, 1, 1)); }
    upper = lower;
  }
  if (leaves.x) {
    upper = vec4u(lookUp(level, block + vec3i(1, 0, 0)));
    if (leaves.z) {
      let other = lookUp(level, block + vec3i(1, 0, 1));
      upper = vec4u(upper.x, other, upper.x, other);
    }
    if (leaves.y) {
      let other = lookUp(level, block + vec3i(1, 1, 0));
      upper = vec4u(upper.xy, other, other);
      if (leaves.z) { upper.w = lookUp(level, block + vec3i(1, 1, 1)); }
    }
  }
#ifdef PARTIAL
  isAbsent = any(lower == vec4u(ABSENT)) || any(upper == vec4u(ABSENT));
#endif
  let first = vec3u(low);
  let last = select(first + 1u, vec3u(0u), leaves);
  let within = (vec4u(first.y, first.y, last.y, last.y) << vec4u(11u)) + vec4u(first.z, last.z, first.z, last.z) - 1u;
  let none = vec4f(0.0);
  let lowerShares = select(shares * g.x, none, lower == vec4u(0u));
  let upperShares = select(shares * f.x, none, upper == vec4u(0u));
  located = Cell(lower + within + (first.x << 22u), upper + within + (last.x << 22u), lowerShares, upperShares);
  return true;
}

// A texel so far behind its place along the field's x.
fn fetched(atlas: texture_3d<f32>, texel: u32, behind: u32) -> vec4f {
  return textureLoad(atlas, vec3u(texel & 2047u, (texel >> 11u) & 2047u, (texel >> 22u) + behind), 0);
}

fn densityOf(texel: u32) -> f32 {
#ifdef BESIDE
  return fetched(u_color, texel, u32((QUADS - 1) * u_slotsDeep() * u_slot())).a;
#else
  return fetched(u_density, texel, 0u).r;
#endif
}

fn densitiesOf(texels: vec4u) -> vec4f {
  return vec4f(densityOf(texels.x), densityOf(texels.y), densityOf(texels.z), densityOf(texels.w));
}

// What an offset from the middle code means, but for the center.
fn offsetOf(x: vec4f, step: vec4f, curve: vec4f) -> vec4f {
  return x * (step + curve * x * x);
}

fn densityTerms(x: vec4f, codes: vec4f) -> vec4f {
#ifdef DENSITY_CURVES
  return offsetOf(x, vec4f(codes.y), vec4f(codes.z));
#else
  return codes.y * x;
#endif
}

// What is interpolated counts as one fetch, of however many texels.
fn densityAt(level: i32, cell: Cell) -> f32 {
  fetches++;
  let codes = u_codes(level * GROUPS);
  let lower = densitiesOf(cell.lower);
  let upper = densitiesOf(cell.upper);
#ifdef EMPTY_DENSITY
  let hasEmpty = vec4<bool>(codes.w < 0.0);
  let none = vec4f(0.0);
  let lowerShares = select(cell.lowerShares, none, hasEmpty & (lower == none));
  let upperShares = select(cell.upperShares, none, hasEmpty & (upper == none));
#else
  let lowerShares = cell.lowerShares;
  let upperShares = cell.upperShares;
#endif
  let stored = dot(lowerShares + upperShares, vec4f(1.0));
  let sum = dot(lowerShares, densityTerms(lower - abs(codes.w), codes)) + dot(upperShares, densityTerms(upper - abs(codes.w), codes));
  return codes.x * stored + sum + (1.0 - stored) * u_empty(level).x;
}

// What a code means beyond what is there where nothing is stored.
fn beyond(code: vec4f, middle: vec4f, base: vec4f, step: vec4f, curve: vec4f) -> vec4f {
#ifdef CURVES
  let value = base + offsetOf(code - abs(middle), step, curve);
#else
  let value = base + step * (code - abs(middle));
#endif
#ifdef EMPTY_CODES
  return select(value, vec4f(0.0), (code == vec4f(0.0)) & (middle < vec4f(0.0)));
#else
  return value;
#endif
}

// Four channels of an atlas, of two groups at most: those where `isLast` holds are of the second, the others of the first.
fn quadAt(atlas: texture_3d<f32>, quad: i32, cell: Cell, first: vec4f, last: vec4f, isLast: vec4<bool>, empty: vec4f) -> vec4f {
  fetches++;
  // Quadruples of all slots lie one behind the other.
  let behind = u32(quad * u_slotsDeep() * u_slot());
  let middle = select(first.wwww, last.wwww, isLast);
  let base = select(first.xxxx, last.xxxx, isLast) - empty;
  let step = select(first.yyyy, last.yyyy, isLast);
  let curve = select(first.zzzz, last.zzzz, isLast);
  return empty + cell.lowerShares.x * beyond(fetched(atlas, cell.lower.x, behind), middle, base, step, curve) +
    cell.lowerShares.y * beyond(fetched(atlas, cell.lower.y, behind), middle, base, step, curve) +
    cell.lowerShares.z * beyond(fetched(atlas, cell.lower.z, behind), middle, base, step, curve) +
    cell.lowerShares.w * beyond(fetched(atlas, cell.lower.w, behind), middle, base, step, curve) +
    cell.upperShares.x * beyond(fetched(atlas, cell.upper.x, behind), middle, base, step, curve) +
    cell.upperShares.y * beyond(fetched(atlas, cell.upper.y, behind), middle, base, step, curve) +
    cell.upperShares.z * beyond(fetched(atlas, cell.upper.z, behind), middle, base, step, curve) +
    cell.upperShares.w * beyond(fetched(atlas, cell.upper.w, behind), middle, base, step, curve);
}

// The group of a channel of colour.
fn groupOf(channel: i32) -> i32 {
#ifdef FUNCTIONS
  return select(select(select(4, 3, channel < 27), 2, channel < 12), 1, channel < 3);
#else
  return select(2, 1, channel < 3);
#endif
}

// What a group of colour is where nothing is stored.
fn emptyColor(level: i32, group: i32) -> f32 {
#ifdef FUNCTIONS
  if (group > 1) { return u_emptyBands(level)[group - 2]; }
#endif
  return select(u_empty(level).z, u_empty(level).y, group == 1);
}

#ifdef FUNCTIONS
fn colorsOf(level: i32, quad: i32, stored: bool, cell: Cell) -> vec4f {
  // Channels behind the last are not used as colours.
  let first = groupOf(4 * quad);
  let last = min(groupOf(4 * quad + 3), LAST_COLOR);
  let isLast = vec4i(first, groupOf(4 * quad + 1), groupOf(4 * quad + 2), last) == vec4i(last);
  let empty = select(vec4f(emptyColor(level, first)), vec4f(emptyColor(level, last)), isLast);
  if (!stored) { return empty; }
  return quadAt(u_color, quad, cell, u_codes(level * GROUPS + first), u_codes(level * GROUPS + last), isLast, empty);
}
#endif

fn colorAt(level: i32, stored: bool, cell: Cell, color: ptr<function, array<vec4f, QUADS>>) {
#ifdef FUNCTIONS
  for (var quad = 0; quad < QUADS; quad++) { (*color)[quad] = colorsOf(level, quad, stored, cell); }
#else
  let empty = u_empty(level);
  // Behind three channels of the first group.
  let second = vec4<bool>(false, false, false, true);
  let diffuse = u_codes(level * GROUPS + 1);
  let features = u_codes(level * GROUPS + LAST_COLOR);
  for (var quad = 0; quad < QUADS; quad++) { (*color)[quad] = select(empty.zzzz, empty.yyyz, quad == 0); }
  if (!stored) { return; }
  for (var quad = 0; quad < QUADS; quad++) { (*color)[quad] = quadAt(u_color, quad, cell, select(features, diffuse, quad == 0), features, second, (*color)[quad]); }
#endif
}

#ifdef DIRECTIONAL
// Four values that depend on the direction: see `field.glsl`.
fn directionalAt(level: i32, quad: i32, cell: Cell, empty: vec4f) -> vec4f {
#if defined(ANISOTROPY) && defined(BRIGHTNESS)
  let isLast = vec4<bool>(false, quad == 1, quad == 1, quad == 1);
  return quadAt(u_directional, quad, cell, u_codes(level * GROUPS + ANISOTROPY), u_codes(level * GROUPS + BRIGHTNESS), isLast, empty);
#else
#ifdef ANISOTROPY
  let codes = u_codes(level * GROUPS + ANISOTROPY);
#else
  let codes = u_codes(level * GROUPS + BRIGHTNESS);
#endif
  return quadAt(u_directional, quad, cell, codes, codes, vec4<bool>(false), empty);
#endif
}
#endif

#ifdef MASKED
fn maskNode(node: vec3i) -> f32 {
  fetches++;
  return textureLoad(u_mask, node.zyx, 0).r;
}

// Whether a position is outside the mask.
fn masked(position: vec3f) -> bool {
  let at = u_toMask() * position + u_maskShift();
  let size = vec3i(textureDimensions(u_mask)).zyx;
  if (u_maskNearest()) {
    let nearest = round(at);
    if (any(nearest < vec3f(0.0)) || any(nearest >= vec3f(size))) { return true; }
    return maskNode(vec3i(nearest)) < 0.5;
  }
  if (any(at < vec3f(0.0)) || any(at > vec3f(size - 1))) { return true; }
  let low = min(vec3i(at), size - 2);
  let f = at - vec3f(low);
  var sum = 0.0;
  for (var corner = 0; corner < 8; corner++) {
    let up = vec3i(corner >> 2u, corner >> 1u, corner) & vec3i(1);
    let weight = mix(1.0 - f, f, vec3f(up));
    sum += weight.x * weight.y * weight.z * maskNode(low + up);
  }
  return sum < u_maskThreshold();
}
#endif

// The skip distance of a macro cell for samples of the levels from `first` to `last`.
fn skipDistance(macroCell: vec3i, first: i32, last: i32) -> i32 {
  var place = macroCell;
  // A box shows no level before its own number.
  let low = first - box;
  let high = last - box;
#ifdef NESTED
  place += vec3i(0, MACRO_ROOM * vec2i(box % BOXES_BESIDE, box / BOXES_BESIDE));
#endif
  var least = 255;
  for (var quad = low / 4; quad <= high / 4; quad++) {
    fetches++;
    let distances = vec4i(textureLoad(u_skipDistances, vec3i(place.zy, place.x + quad * u_macroCounts(box).x), 0));
    for (var i = 0; i < 4; i++) {
      let level = quad * 4 + i;
      if (level >= low && level <= high) { least = min(least, distances[i]); }
    }
  }
  return least;
}
