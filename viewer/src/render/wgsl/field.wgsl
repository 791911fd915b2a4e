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

#ifdef PARTIAL
// Whether the block that was located last is stored, but has no slot.
var<private> isAbsent: bool = false;
#endif

// The texel of a position in the slot of its cell's block; not stored where the level has none.
struct Found { stored: bool, texel: vec3f }

fn locate(level: i32, position: vec3f) -> Found {
  let nodes = u_nodes(level).xyz;
  let edge = u_nodes(level).w;
  let at = position * vec3f(nodes - 1);
  // Half a node above the lowest one no rounding moves the quotient past a whole number; processors divide whole numbers
  // one by one.
  let block = vec3i((vec3f(min(vec3i(at), nodes - 2)) + 0.5) / f32(edge));
  let isOdd = (levelOfPart(level) & 1) == 1;
  var place = select(placeEven, placeOdd, isOdd);
  let wanted = vec4i(block, level);
  if (any(select(lookedUpEven, lookedUpOdd, isOdd) != wanted)) {
    place = textureLoad(u_table, vec3i(block.zy, block.x + u_levels(level).x), 0).r;
    fetches++;
    if (isOdd) {
      lookedUpOdd = wanted;
      placeOdd = place;
    } else {
      lookedUpEven = wanted;
      placeEven = place;
    }
  }
#ifdef PARTIAL
  isAbsent = place >> 31u == 1u;
#endif
  let slot = vec3u(place, place >> 10u, place >> 20u) & vec3u(1023u);
  let texel = vec3f(slot) * f32(u_slot()) + 0.5 + (at - vec3f(block * edge)).zyx;
  // A dense grid stores everything.
  return Found(place != 0u || !u_skips(), texel);
}

fn densityAt(texel: vec3f) -> f32 {
  fetches++;
  return textureSampleLevel(u_density, DENSITY_SAMPLER, texel / vec3f(textureDimensions(u_density)), 0.0).r;
}

fn colorAt(level: i32, found: Found, color: ptr<function, array<vec4f, QUADS>>) {
  if (!found.stored) {
#ifdef FUNCTIONS
    let bands = u_emptyBands(level);
    for (var channel = 3; channel < 4 * QUADS; channel++) {
      (*color)[channel / 4][channel % 4] = select(select(bands.z, bands.y, channel < 27), bands.x, channel < 12);
    }
#else
    for (var quad = 0; quad < QUADS; quad++) { (*color)[quad] = vec4f(u_empty(level).z); }
#endif
    (*color)[0] = vec4f(vec3f(u_empty(level).y), (*color)[0].w);
    return;
  }
  let size = vec3f(textureDimensions(u_color));
  for (var quad = 0; quad < QUADS; quad++) {
    fetches++;
    // Quadruples of all slots lie one behind the other.
    let place = found.texel + vec3f(0.0, 0.0, f32(quad * u_slotsDeep() * u_slot()));
    (*color)[quad] = textureSampleLevel(u_color, COLOR_SAMPLER, place / size, 0.0);
  }
}

#ifdef FINEST_DIRECTIONAL
// Four values that depend on the direction, of a level from FINEST_DIRECTIONAL on: four of anisotropy; the fifth, and
// directional brightness.
fn directionalAt(quad: i32, texel: vec3f) -> vec4f {
  fetches++;
  let place = texel + vec3f(0.0, 0.0, f32(quad * u_slotsDeep() * u_slot()));
  return textureSampleLevel(u_directional, DIRECTIONAL_SAMPLER, place / vec3f(textureDimensions(u_directional)), 0.0);
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
