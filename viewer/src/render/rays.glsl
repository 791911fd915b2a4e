// A fragment's ray, the level of detail along it, and the colours of what it meets. It follows `field.glsl`, the network's
// source, and `nested.glsl` where boxes lie around each other.

// Where a pixel's ray crosses the plane at distance 1, or that through the camera where rays are parallel.
vec2 onPlane(vec2 pixel) {
  vec2 ndc = (pixel - u_viewport.xy) / u_viewport.zw * 2.0 - 1.0;
  return ndc * u_lens.xy + u_lens.zw;
}

// Of a pixel's ray, in the camera's axes, the start and the direction.
vec3 cameraStart(vec2 pixel) {
  return vec3(u_isParallel ? onPlane(pixel) : vec2(0.0), 0.0);
}

vec3 cameraDirection(vec2 pixel) {
  return vec3(u_isParallel ? vec2(0.0) : onPlane(pixel), -1.0);
}

#ifdef NESTED
#define REGION_LAST regionLast
#define PART(level) partOf(level)
#define PLACE(part) placeIn(boxOf(part), sampled)
#else
#define REGION_LAST last
#define PART(level) level
#define PLACE(part) position
#endif
// What is shown of the finer and the coarser level that a sample lies between.
#ifdef PARTIAL
#define SHOWN(i) PART((i == 0 ? fineLevel : coarseLevel))
#else
#define SHOWN(i) PART(level + i)
#endif

float entry(vec3 origin, vec3 direction) {
  vec3 inverse = 1.0 / mix(direction, vec3(1e-30), equal(direction, vec3(0.0)));
  vec3 near = min((u_lowest - origin) * inverse, (u_highest - origin) * inverse);
  // A ray along a face is between the faces from the start, or never.
  near = mix(near, vec3(-LARGEST), equal(direction, vec3(0.0)));
  return min(max(max(near.x, max(near.y, near.z)), u_range.x), u_range.y);
}

// start + k * step after k steps: offsets in voxels to the rays half a pixel to the right and below, for a whole pixel.
struct Line { vec3 start; vec3 step; };
Line right, below;

float levelOf(float square) {
  float size = 0.5 * log2(max(square, 1e-37));
  float lambda = u_levelOfDetail.x * size + u_levelOfDetail.y;
#ifdef BENDS
  for (int i = 0; i < BENDS; i++) lambda += u_bends[i].y * max(size - u_bends[i].x, 0.0);
#endif
  return max(clamp(lambda, 0.0, u_levelOfDetail.z), float(u_finest));
}

float squareAt(Line line, float k) {
  vec3 offset = line.start + k * line.step;
  return dot(offset, offset);
}

float levelAt(float k) {
#ifdef NESTED
  float level = u_fixedLevel >= 0.0 ? u_fixedLevel : levelOf(max(squareAt(right, k), squareAt(below, k)));
  return max(level, float(box));
#else
  if (u_fixedLevel >= 0.0) return u_fixedLevel;
  return levelOf(max(squareAt(right, k), squareAt(below, k)));
#endif
}

float leastSquare(Line line, float first, float last) {
  float vertex = -dot(line.start, line.step) / max(dot(line.step, line.step), 1e-37);
  return squareAt(line, clamp(vertex, first, last));
}

// From one sample to the next along a direction.
float stepOf(vec3 direction) {
  return u_step / length(direction * u_perVoxel);
}

Line aside(vec2 pixel, float t, float tStep, vec3 origin, vec3 direction) {
  vec3 local = cameraDirection(pixel);
  vec3 other = u_toBox * local;
  vec3 beside = u_toBox * (cameraStart(pixel) - cameraStart(gl_FragCoord.xy));
#ifdef NESTED
  vec3 voxels = 2.0 * u_voxels;
#else
  vec3 voxels = 2.0 * vec3(u_nodes[0].xyz);
#endif
#ifdef ASIDE_SAME_INDEX
  float otherStep = stepOf(u_toLocal * local);
  return Line((beside + other * entry(origin + beside, other) - direction * t) * voxels, (other * otherStep - direction * tStep) * voxels);
#else
  return Line((beside + (other - direction) * t) * voxels, (other - direction) * tStep * voxels);
#endif
}

#if defined(FUNCTIONS) || defined(ANISOTROPY)
// Values of the harmonics along the ray.
float harmonics[16];

void findHarmonics(vec3 d) {
  float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
  harmonics[0] = 0.28209479177387814;
  harmonics[1] = -0.4886025119029199 * d.y;
  harmonics[2] = 0.4886025119029199 * d.z;
  harmonics[3] = -0.4886025119029199 * d.x;
  harmonics[4] = 1.0925484305920792 * d.x * d.y;
  harmonics[5] = -1.0925484305920792 * d.y * d.z;
  harmonics[6] = 0.31539156525252005 * (2.0 * zz - xx - yy);
  harmonics[7] = -1.0925484305920792 * d.x * d.z;
  harmonics[8] = 0.5462742152960396 * (xx - yy);
  harmonics[9] = -0.5900435899266435 * d.y * (3.0 * xx - yy);
  harmonics[10] = 2.890611442640554 * d.x * d.y * d.z;
  harmonics[11] = -0.4570457994644658 * d.y * (4.0 * zz - xx - yy);
  harmonics[12] = 0.3731763325901154 * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
  harmonics[13] = -0.4570457994644658 * d.x * (4.0 * zz - xx - yy);
  harmonics[14] = 1.445305721320277 * d.z * (xx - yy);
  harmonics[15] = -0.5900435899266435 * d.x * (xx - 3.0 * yy);
}
#endif

#ifdef FUNCTIONS
vec3 limited(vec3 color) {
#if CLAMP == 1
  return max(color, 0.0);
#elif CLAMP == 2
  return 1.0 / (1.0 + exp(-color));
#else
  return color;
#endif
}
#endif

#ifdef ANISOTROPY
#ifdef BRIGHTNESS
// What was found beside anisotropy, of even and of odd levels.
vec3 brightnessEven, brightnessOdd;
#endif

// A level's density along the ray.
float densityAlong(int level, Cell cell) {
  float density = densityAt(level, cell);
  if ((u_levels[level].w & 1) == 0) return density;
  vec4 low = directionalAt(level, 0, cell, vec4(0.0));
  vec4 high = directionalAt(level, 1, cell, vec4(0.0, vec3(u_empty[level].w)));
#ifdef BRIGHTNESS
  if ((LEVEL_OF(level) & 1) == 1) brightnessOdd = high.yzw;
  else brightnessEven = high.yzw;
#endif
  return max(density + dot(low, vec4(harmonics[4], harmonics[5], harmonics[6], harmonics[7])) + high.x * harmonics[8], 0.0);
}
#endif

#ifdef BRIGHTNESS
// The ray's unit direction in the world.
vec3 along;

// What a level adds to its logits of diffuse colour along the ray.
float addedLogit(int level, bool stored, Cell cell) {
  int has = u_levels[level].w;
  if ((has & 2) == 0) return 0.0;
  vec4 empty = vec4(u_empty[level].w);
  if (!stored) return dot(along, empty.xyz);
#ifdef ANISOTROPY
  if (has == 3) return dot(along, (LEVEL_OF(level) & 1) == 1 ? brightnessOdd : brightnessEven);
  return dot(along, directionalAt(level, 1, cell, empty).yzw);
#else
  return dot(along, directionalAt(level, 0, cell, empty).xyz);
#endif
}
#endif

void activate(inout vec4 color[QUADS]) {
#if defined(FUNCTIONS)
  vec3 sum = vec3(OFFSET);
  for (int number = 0; number < FUNCTIONS; number++) {
    for (int channel = 0; channel < 3; channel++) {
      int at = 3 * number + channel;
      sum[channel] += harmonics[number] * color[at / 4][at % 4];
    }
  }
#ifdef CLAMP_SAMPLES
  sum = limited(sum);
#endif
  color[0] = vec4(sum, 0.0);
#elif !defined(LINEAR)
  for (int quad = 0; quad < QUADS; quad++) color[quad] = 1.0 / (1.0 + exp(-color[quad]));
#endif
}

// IEC 61966-2-1.
vec3 linear(vec3 display) {
  return mix(pow((display + 0.055) / 1.055, vec3(2.4)), display / 12.92, vec3(lessThanEqual(display, vec3(0.04045))));
}

vec3 levelTint(float level) {
  float x = float(LAST_TINT) * level / max(float(LEVELS - 1), 1.0);
  vec3 tints[LAST_TINT + 1] = TINTS;
  int low = min(int(x), LAST_TINT - 1);
  return mix(tints[low], tints[low + 1], x - float(low));
}
