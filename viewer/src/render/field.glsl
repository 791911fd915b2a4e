// What the device holds of a field, and what is interpolated from it. Positions are shares of a box, 0 to 1 along each
// axis. Where boxes lie around each other, what is said of levels holds of parts. `shader.ts` says what is defined.

precision highp float;
precision highp int;
precision highp sampler3D;
precision highp usampler3D;

layout(location = 0) out vec4 fragment;

// Slots of nodes, and the places of their blocks; x of a texture is z of the field.
uniform sampler3D u_density;
uniform sampler3D u_color;
#ifdef FINEST_DIRECTIONAL
uniform sampler3D u_directional;
#endif
uniform usampler3D u_table;
uniform usampler3D u_skipDistances;
uniform sampler2D u_weights;
uniform int u_slot;
uniform int u_slotsDeep;
// Of each level: nodes along the axes and of a block's edge; where its table starts along the field's x, whether it has
// density, how that is decoded, and whether it has anisotropy; what density, diffuse colour, features and directional brightness are where nothing is
// stored.
uniform ivec4 u_nodes[PARTS];
uniform ivec4 u_levels[PARTS];
uniform vec4 u_empty[PARTS];
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
// Whether the block that was located last is stored, but has no slot.
bool isAbsent;
#endif

// The texel of a position in the slot of its cell's block; false where the level stores none.
bool locate(int level, vec3 position, out vec3 texel) {
  ivec3 nodes = u_nodes[level].xyz;
  int edge = u_nodes[level].w;
  vec3 at = position * vec3(nodes - 1);
  // Half a node above the lowest one no rounding moves the quotient past a whole number; processors divide whole numbers
  // one by one.
  ivec3 block = ivec3((vec3(min(ivec3(at), nodes - 2)) + 0.5) / float(edge));
  bool isOdd = (LEVEL_OF(level) & 1) == 1;
  uint place = isOdd ? placeOdd : placeEven;
  ivec4 wanted = ivec4(block, level);
  if ((isOdd ? lookedUpOdd : lookedUpEven) != wanted) {
    place = texelFetch(u_table, ivec3(block.zy, block.x + u_levels[level].x), 0).r;
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
  isAbsent = place >> 31 == 1u;
#endif
  uvec3 slot = uvec3(place, place >> 10, place >> 20) & 1023u;
  texel = vec3(slot) * float(u_slot) + 0.5 + (at - vec3(block * edge)).zyx;
  // A dense grid stores everything.
  return place != 0u || !u_skips;
}

float densityAt(vec3 texel) {
  fetches++;
  return textureLod(u_density, texel / vec3(textureSize(u_density, 0)), 0.0).r;
}

void colorAt(int level, bool stored, vec3 texel, out vec4 color[QUADS]) {
  if (!stored) {
#ifdef FUNCTIONS
    vec3 bands = u_emptyBands[level];
    for (int channel = 3; channel < 4 * QUADS; channel++) color[channel / 4][channel % 4] = channel < 12 ? bands.x : channel < 27 ? bands.y : bands.z;
#else
    for (int quad = 0; quad < QUADS; quad++) color[quad] = vec4(u_empty[level].z);
#endif
    color[0].xyz = vec3(u_empty[level].y);
    return;
  }
  vec3 size = vec3(textureSize(u_color, 0));
  for (int quad = 0; quad < QUADS; quad++) {
    fetches++;
    // Quadruples of all slots lie one behind the other.
    vec3 place = texel + vec3(0.0, 0.0, float(quad * u_slotsDeep * u_slot));
    color[quad] = textureLod(u_color, place / size, 0.0);
  }
}

#ifdef FINEST_DIRECTIONAL
// Four values that depend on the direction, of a level from FINEST_DIRECTIONAL on: four of anisotropy; the fifth, and
// directional brightness.
vec4 directionalAt(int quad, vec3 texel) {
  fetches++;
  vec3 place = texel + vec3(0.0, 0.0, float(quad * u_slotsDeep * u_slot));
  return textureLod(u_directional, place / vec3(textureSize(u_directional, 0)), 0.0);
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
