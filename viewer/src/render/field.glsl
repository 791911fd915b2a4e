// What the device holds of a field, and what is interpolated from it. Positions are shares of a box, 0 to 1 along each
// axis. Where boxes lie around each other, what is said of levels holds of parts. `shader.ts` says what is defined.

precision highp float;
precision highp int;
precision highp sampler3D;
precision highp usampler3D;

layout(location = 0) out vec4 fragment;

// Slots of nodes, and the places of their blocks; x of a texture is z of the field.
#ifndef BESIDE
uniform sampler3D u_density;
#endif
uniform sampler3D u_color;
#ifdef DIRECTIONAL
uniform sampler3D u_directional;
#endif
uniform usampler3D u_table;
uniform usampler3D u_skipDistances;
uniform sampler2D u_weights;
uniform int u_slot;
uniform int u_slotsDeep;
// Of each level: nodes along the axes and of a block's edge; where its table starts along the field's x, whether it has
// density, how that is decoded, and whether it has anisotropy (1), directional brightness (2) or both (3); what density, diffuse
// colour, features and directional brightness are where nothing is stored.
uniform ivec4 u_nodes[PARTS];
uniform ivec4 u_levels[PARTS];
uniform vec4 u_empty[PARTS];
// Of each level and group of channels, what `decoding` of texels.ts says. Density is the first group, diffuse colour the second.
uniform vec4 u_codes[PARTS * GROUPS];
#ifdef FUNCTIONS
// The same of the coefficients of bands 1 to 3.
uniform vec3 u_emptyBands[PARTS];
#endif
// The finest level that is there; the level to show, or less than 0 for the rule's.
uniform int u_finest;
uniform float u_fixedLevel;
uniform int u_output;
// False marches as if nothing were known: through empty space, behind what is opaque, with all colours.
uniform bool u_skips;
// Of the picture's pixels, which are not the target's where a picture is only counted.
uniform float u_halfPixel;

uniform vec4 u_viewport;
// What ndc is divided by, and then the shift, to be a direction of the camera; or a start where rays are parallel.
uniform vec4 u_lens;
uniform bool u_isParallel;
uniform vec3 u_origin;
uniform mat3 u_toBox;
uniform mat3 u_toLocal;
uniform mat3 u_toView;
// A shift, and what the inverse of t is multiplied by, or t itself where rays are parallel; and the depth of what is furthest.
uniform vec2 u_depthOfT;
uniform float u_farDepth;
// Where depth is logarithmic, it is x * log2(y + z * t); else x is 0.
uniform vec3 u_logarithm;
// Whether the target takes linear values: all but the canvas do.
uniform bool u_linear;

// shift, interval; near, far; alpha and colour threshold; step in voxels; voxels
// in a world unit along each axis; the interval in world units; steps at most.
uniform vec2 u_activation;
uniform vec2 u_range;
uniform vec2 u_thresholds;
// The part of the box in which samples lie, 0 to 1.
uniform vec3 u_lowest;
uniform vec3 u_highest;
uniform float u_step;
uniform vec3 u_perVoxel;
uniform float u_interval;
uniform float u_mostSteps;
// factor, bias, most.
uniform vec3 u_levelOfDetail;
#ifdef BENDS
// From log2 of the footprint of x on, the slope grows by y.
uniform vec2 u_bends[BENDS];
#endif
#ifdef NESTED
// Of each box.
uniform ivec3 u_macroCounts[BOXES];
uniform vec3 u_macroScale[BOXES];
// The smallest box that holds what is sampled.
int box = 0;
#define MACRO_COUNTS u_macroCounts[box]
#define MACRO_SCALE u_macroScale[box]
#define LEVEL_OF(part) (part < LEVELS ? part : part - LEVELS + 1)
#else
uniform ivec3 u_macroCounts;
uniform vec3 u_macroScale;
#define MACRO_COUNTS u_macroCounts
#define MACRO_SCALE u_macroScale
#define LEVEL_OF(level) level
#endif

#ifdef MASKED
uniform sampler3D u_mask;
uniform mat3 u_toMask;
uniform vec3 u_maskShift;
uniform bool u_maskNearest;
uniform float u_maskThreshold;
#endif

// Optical depth from which a ray ends: transmittance 1e-5.
const float OPAQUE_DEPTH = 11.6;
// Positions so little beyond a face lie on it: f32 of an entry is no closer.
const float ON_FACE = 1e-6;
const float LARGEST = 3e38;

int fetches = 0;
// The block that was looked up last, and its level, of even and of odd levels; what the table says there. No arrays:
// cards keep those in memory.
ivec4 lookedUpEven = ivec4(-1), lookedUpOdd = ivec4(-1);
uint placeEven = 0u, placeOdd = 0u;

float softplus(float x) {
  return max(x, 0.0) + log(1.0 + exp(-abs(x)));
}

// 1 - exp(-depth), also where that is small.
float opacity(float depth) {
  return depth < 1e-3 ? depth * (1.0 - 0.5 * depth) : 1.0 - exp(-depth);
}

float opaqueDepth(float alpha) {
  return -log(1.0 - clamp(alpha, 0.0, 1.0 - 1.1920929e-7));
}

// Optical depth over one interval.
#ifdef DECODE
#define DECODE_OF(level) DECODE
#else
#define DECODE_OF(level) u_levels[level].z
#endif
float opticalDepth(float density, int decode) {
  if (decode == 1) return min(density * density, LARGEST);
  if (decode == 2) return opaqueDepth(density);
#if ORDER == 0 && defined(RELU)
  return min(max(density, 0.0) * u_activation.y, LARGEST);
#elif ORDER == 0
  return min(softplus(density + u_activation.x) * u_activation.y, LARGEST);
#elif ORDER == 1
  return min(max(density, 0.0) * u_activation.y, LARGEST);
#else
  return opaqueDepth(density);
#endif
}

#ifdef PARTIAL
// In the table: the block is stored, but has no slot.
const uint ABSENT = 0xffffffffu;
// Whether that holds for a block of the cell that was located last.
bool isAbsent;
#endif

// The corners of the cell that a position lies in: texels, with 11 bits for x and y and 10 for z, and shares of what is
// interpolated, 0 of those that are not stored. Of `lower` and `upper`, along the field's x, the second corner is the next one
// along its z, the third along its y, and the fourth along both.
struct Cell { uvec4 lower, upper; vec4 lowerShares, upperShares; };
// The cell that was located last. What is assigned costs a processor more than what is computed, so that structures are
// neither copied nor returned, and sums over corners are one expression.
Cell located;

// One more than the first texel of a block's slot; 0 where it is not stored.
uint lookUp(int level, ivec3 block) {
  fetches++;
  return texelFetch(u_table, ivec3(block.zy, block.x + u_levels[level].x), 0).r;
}

// False where the level stores nothing at the position.
bool locate(int level, vec3 position) {
  ivec3 nodes = u_nodes[level].xyz;
  int edge = u_nodes[level].w;
  vec3 at = position * vec3(nodes - 1);
  ivec3 lowest = min(ivec3(at), nodes - 2);
  // Half a node above the lowest one no rounding moves the quotient past a whole number; processors divide whole numbers
  // one by one.
  ivec3 block = ivec3((vec3(lowest) + 0.5) / float(edge));
  bool isOdd = (LEVEL_OF(level) & 1) == 1;
  uint place = isOdd ? placeOdd : placeEven;
  ivec4 wanted = ivec4(block, level);
  if ((isOdd ? lookedUpOdd : lookedUpEven) != wanted) {
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
  if (place == 0u && u_skips) return false;
  ivec3 low = lowest - block * edge;
  vec3 f = at - vec3(lowest);
  vec4 shares = vec4(1.0 - f.yy, f.yy) * vec4(1.0 - f.z, f.z, 1.0 - f.z, f.z);
  // Along these axes, the cell has nodes of the next blocks.
  bvec3 leaves = equal(low, ivec3(edge - 1));
  if (place != 0u && !any(leaves)) {
    located.lower = uvec4(0u, 1u, 2048u, 2049u) + (place - 1u + (uint(low.x) << 22) + uint(low.y << 11) + uint(low.z));
    located.upper = located.lower + (1u << 22);
    located.lowerShares = shares * (1.0 - f.x);
    located.upperShares = shares * f.x;
    return true;
  }
  uvec4 lower = uvec4(place), upper = uvec4(place);
  if (leaves.z) lower.yw = upper.yw = uvec2(lookUp(level, block + ivec3(0, 0, 1)));
  if (leaves.y) {
    lower.zw = upper.zw = uvec2(lookUp(level, block + ivec3(0, 1, 0)));
    if (leaves.z) lower.w = upper.w = lookUp(level, block + ivec3(0, 1, 1));
  }
  if (leaves.x) {
    upper = uvec4(lookUp(level, block + ivec3(1, 0, 0)));
    if (leaves.z) upper.yw = uvec2(lookUp(level, block + ivec3(1, 0, 1)));
    if (leaves.y) {
      upper.zw = uvec2(lookUp(level, block + ivec3(1, 1, 0)));
      if (leaves.z) upper.w = lookUp(level, block + ivec3(1, 1, 1));
    }
  }
#ifdef PARTIAL
  isAbsent = any(equal(lower, uvec4(ABSENT))) || any(equal(upper, uvec4(ABSENT)));
#endif
  uvec3 first = uvec3(low), last = uvec3(not(leaves)) * (first + 1u);
  uvec4 within = (uvec4(first.y, first.y, last.y, last.y) << 11) + uvec4(first.z, last.z, first.z, last.z) - 1u;
  located.lower = lower + within + (first.x << 22);
  located.upper = upper + within + (last.x << 22);
  located.lowerShares = shares * (1.0 - f.x) * vec4(notEqual(lower, uvec4(0u)));
  located.upperShares = shares * f.x * vec4(notEqual(upper, uvec4(0u)));
  return true;
}

// A texel so far behind its place along the field's x.
vec4 fetched(sampler3D atlas, uint texel, int behind) {
  return texelFetch(atlas, ivec3(texel & 2047u, texel >> 11 & 2047u, int(texel >> 22) + behind), 0);
}

vec4 densitiesOf(uvec4 texels) {
#ifdef BESIDE
#define DENSITY_OF(texel) fetched(u_color, texel, (QUADS - 1) * u_slotsDeep * u_slot).a
#else
#define DENSITY_OF(texel) fetched(u_density, texel, 0).r
#endif
  return vec4(DENSITY_OF(texels.x), DENSITY_OF(texels.y), DENSITY_OF(texels.z), DENSITY_OF(texels.w));
}

// What an offset from the middle code means, but for the center.
vec4 offsetOf(vec4 x, vec4 step, vec4 curve) {
  return x * (step + curve * x * x);
}

// What is interpolated counts as one fetch, of however many texels.
float densityAt(int level, Cell cell) {
  fetches++;
  vec4 codes = u_codes[level * GROUPS];
#ifdef DENSITY_CURVES
#define DENSITY_TERMS(x) offsetOf(x, vec4(codes.y), vec4(codes.z))
#else
#define DENSITY_TERMS(x) (codes.y * (x))
#endif
#ifdef EMPTY_DENSITY
  vec4 lower = densitiesOf(cell.lower), upper = densitiesOf(cell.upper);
  vec4 lowerShares = cell.lowerShares, upperShares = cell.upperShares;
  if (codes.w < 0.0) {
    lowerShares *= vec4(notEqual(lower, vec4(0.0)));
    upperShares *= vec4(notEqual(upper, vec4(0.0)));
  }
  float stored = dot(lowerShares + upperShares, vec4(1.0));
  float sum = dot(lowerShares, DENSITY_TERMS(lower - abs(codes.w))) + dot(upperShares, DENSITY_TERMS(upper - abs(codes.w)));
#else
  float stored = dot(cell.lowerShares + cell.upperShares, vec4(1.0));
  float sum = dot(cell.lowerShares, DENSITY_TERMS(densitiesOf(cell.lower) - codes.w)) +
    dot(cell.upperShares, DENSITY_TERMS(densitiesOf(cell.upper) - codes.w));
#endif
  return codes.x * stored + sum + (1.0 - stored) * u_empty[level].x;
}

// What a code means beyond what is there where nothing is stored.
vec4 beyond(vec4 code, vec4 middle, vec4 base, vec4 step, vec4 curve) {
#ifdef CURVES
  vec4 value = base + offsetOf(code - abs(middle), step, curve);
#else
  vec4 value = base + step * (code - abs(middle));
#endif
#ifdef EMPTY_CODES
  return value * (1.0 - vec4(equal(code, vec4(0.0))) * vec4(lessThan(middle, vec4(0.0))));
#else
  return value;
#endif
}

// Four channels of an atlas, of two groups at most: those where `isLast` is 1 are of the second, the others of the first.
vec4 quadAt(sampler3D atlas, int quad, Cell cell, vec4 first, vec4 last, vec4 isLast, vec4 empty) {
  fetches++;
  // Quadruples of all slots lie one behind the other.
  int behind = quad * u_slotsDeep * u_slot;
  vec4 middle = mix(first.wwww, last.wwww, isLast), base = mix(first.xxxx, last.xxxx, isLast) - empty;
  vec4 step = mix(first.yyyy, last.yyyy, isLast), curve = mix(first.zzzz, last.zzzz, isLast);
#define CORNER(texel, share) share * beyond(fetched(atlas, texel, behind), middle, base, step, curve)
  return empty + CORNER(cell.lower.x, cell.lowerShares.x) + CORNER(cell.lower.y, cell.lowerShares.y) +
    CORNER(cell.lower.z, cell.lowerShares.z) + CORNER(cell.lower.w, cell.lowerShares.w) +
    CORNER(cell.upper.x, cell.upperShares.x) + CORNER(cell.upper.y, cell.upperShares.y) +
    CORNER(cell.upper.z, cell.upperShares.z) + CORNER(cell.upper.w, cell.upperShares.w);
}

// The group of a channel of colour.
int groupOf(int channel) {
#ifdef FUNCTIONS
  return channel < 3 ? 1 : channel < 12 ? 2 : channel < 27 ? 3 : 4;
#else
  return channel < 3 ? 1 : 2;
#endif
}

// What a group of colour is where nothing is stored.
float emptyColor(int level, int group) {
#ifdef FUNCTIONS
  if (group > 1) return group == 2 ? u_emptyBands[level].x : group == 3 ? u_emptyBands[level].y : u_emptyBands[level].z;
#endif
  return group == 1 ? u_empty[level].y : u_empty[level].z;
}

#ifdef FUNCTIONS
vec4 colorsOf(int level, int quad, bool stored, Cell cell) {
  // Channels behind the last are not used as colours.
  int first = groupOf(4 * quad), last = min(groupOf(4 * quad + 3), LAST_COLOR);
  ivec4 groups = ivec4(first, groupOf(4 * quad + 1), groupOf(4 * quad + 2), last);
  vec4 isLast = vec4(equal(groups, ivec4(last)));
  vec4 empty = mix(vec4(emptyColor(level, first)), vec4(emptyColor(level, last)), isLast);
  return stored ? quadAt(u_color, quad, cell, u_codes[level * GROUPS + first], u_codes[level * GROUPS + last], isLast, empty) : empty;
}
#endif

void colorAt(int level, bool stored, Cell cell, out vec4 color[QUADS]) {
#ifdef FUNCTIONS
  for (int quad = 0; quad < QUADS; quad++) color[quad] = colorsOf(level, quad, stored, cell);
#else
  vec2 empty = u_empty[level].yz;
  // Behind three channels of the first group.
  vec4 second = vec4(0.0, 0.0, 0.0, 1.0);
  vec4 diffuse = u_codes[level * GROUPS + 1], features = u_codes[level * GROUPS + LAST_COLOR];
  for (int quad = 0; quad < QUADS; quad++) color[quad] = quad == 0 ? mix(empty.xxxx, empty.yyyy, second) : empty.yyyy;
  if (!stored) return;
  for (int quad = 0; quad < QUADS; quad++) color[quad] = quadAt(u_color, quad, cell, quad == 0 ? diffuse : features, features, second, color[quad]);
#endif
}

#ifdef DIRECTIONAL
// Four values that depend on the direction. Anisotropy comes first, if the field has it: its fifth value is the first of the
// second quadruple. Of levels that have some values, the others are 0.
vec4 directionalAt(int level, int quad, Cell cell, vec4 empty) {
#if defined(ANISOTROPY) && defined(BRIGHTNESS)
  vec4 isLast = quad == 0 ? vec4(0.0) : vec4(0.0, 1.0, 1.0, 1.0);
  return quadAt(u_directional, quad, cell, u_codes[level * GROUPS + ANISOTROPY], u_codes[level * GROUPS + BRIGHTNESS], isLast, empty);
#else
#ifdef ANISOTROPY
  vec4 codes = u_codes[level * GROUPS + ANISOTROPY];
#else
  vec4 codes = u_codes[level * GROUPS + BRIGHTNESS];
#endif
  return quadAt(u_directional, quad, cell, codes, codes, vec4(0.0), empty);
#endif
}
#endif

#ifdef MASKED
float maskNode(ivec3 node) {
  fetches++;
  return texelFetch(u_mask, node.zyx, 0).r;
}

// Whether a position is outside the mask.
bool masked(vec3 position) {
  vec3 at = u_toMask * position + u_maskShift;
  ivec3 size = textureSize(u_mask, 0).zyx;
  if (u_maskNearest) {
    vec3 nearest = roundEven(at);
    if (any(lessThan(nearest, vec3(0.0))) || any(greaterThanEqual(nearest, vec3(size)))) return true;
    return maskNode(ivec3(nearest)) < 0.5;
  }
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(size - 1)))) return true;
  ivec3 low = min(ivec3(at), size - 2);
  vec3 f = at - vec3(low);
  float sum = 0.0;
  for (int corner = 0; corner < 8; corner++) {
    ivec3 up = ivec3(corner >> 2, corner >> 1, corner) & 1;
    vec3 weight = mix(1.0 - f, f, vec3(up));
    sum += weight.x * weight.y * weight.z * maskNode(low + up);
  }
  return sum < u_maskThreshold;
}
#endif

// The skip distance of a macro cell for samples of these levels.
int skipDistance(ivec3 place, ivec2 levels) {
#ifdef NESTED
  // A box shows no level before its own number.
  levels -= box;
  place.yz += MACRO_ROOM * ivec2(box % BOXES_BESIDE, box / BOXES_BESIDE);
#endif
  int least = 255;
  for (int quad = levels.x / 4; quad <= levels.y / 4; quad++) {
    fetches++;
    ivec4 skipDistances = ivec4(texelFetch(u_skipDistances, ivec3(place.zy, place.x + quad * MACRO_COUNTS.x), 0));
    for (int i = 0; i < 4; i++) {
      int level = quad * 4 + i;
      if (level >= levels.x && level <= levels.y) least = min(least, skipDistances[i]);
    }
  }
  return least;
}
