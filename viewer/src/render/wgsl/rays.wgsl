// A fragment's ray, the level of detail along it, and the colours of what it meets: `rays.glsl` in WGSL.

// The middle of the fragment's pixel.
var<private> middle: vec2f;

// Where a pixel's ray crosses the plane at distance 1, or that through the camera where rays are parallel.
fn onPlane(pixel: vec2f) -> vec2f {
  let ndc = (pixel - u_viewport().xy) / u_viewport().zw * 2.0 - 1.0;
  return ndc * u_lens().xy + u_lens().zw;
}

// Of a pixel's ray, in the camera's axes, the start and the direction.
fn cameraStart(pixel: vec2f) -> vec3f {
  return vec3f(select(vec2f(0.0), onPlane(pixel), u_isParallel()), 0.0);
}

fn cameraDirection(pixel: vec2f) -> vec3f {
  return vec3f(select(onPlane(pixel), vec2f(0.0), u_isParallel()), -1.0);
}

fn entry(origin: vec3f, direction: vec3f) -> f32 {
  let isAlong = direction == vec3f(0.0);
  let inverse = 1.0 / select(direction, vec3f(1e-30), isAlong);
  var near = min((u_lowest() - origin) * inverse, (u_highest() - origin) * inverse);
  // A ray along a face is between the faces from the start, or never.
  near = select(near, vec3f(-LARGEST), isAlong);
  return min(max(max(near.x, max(near.y, near.z)), u_range().x), u_range().y);
}

// start + k * perStep after k steps: offsets in voxels to the rays half a pixel to the right and below, for a whole pixel.
struct Line { start: vec3f, perStep: vec3f }
var<private> right: Line;
var<private> below: Line;

fn levelOf(square: f32) -> f32 {
  let size = 0.5 * log2(max(square, 1e-37));
  var lambda = u_levelOfDetail().x * size + u_levelOfDetail().y;
#ifdef BENDS
  for (var i = 0; i < BENDS; i++) { lambda += u_bends(i).y * max(size - u_bends(i).x, 0.0); }
#endif
  return max(clamp(lambda, 0.0, u_levelOfDetail().z), f32(u_finest()));
}

fn squareAt(line: Line, k: f32) -> f32 {
  let offset = line.start + k * line.perStep;
  return dot(offset, offset);
}

fn levelAt(k: f32) -> f32 {
  var level = u_fixedLevel();
  if (level < 0.0) { level = levelOf(max(squareAt(right, k), squareAt(below, k))); }
#ifdef NESTED
  level = max(level, f32(box));
#endif
  return level;
}

fn leastSquare(line: Line, first: f32, last: f32) -> f32 {
  let vertex = -dot(line.start, line.perStep) / max(dot(line.perStep, line.perStep), 1e-37);
  return squareAt(line, clamp(vertex, first, last));
}

// From one sample to the next along a direction.
fn stepOf(direction: vec3f) -> f32 {
  return u_step() / length(direction * u_perVoxel());
}

fn aside(pixel: vec2f, t: f32, tStep: f32, origin: vec3f, direction: vec3f) -> Line {
  let local = cameraDirection(pixel);
  let other = u_toBox() * local;
  let beside = u_toBox() * (cameraStart(pixel) - cameraStart(middle));
#ifdef NESTED
  let voxels = 2.0 * u_voxels();
#else
  let voxels = 2.0 * vec3f(u_nodes(0).xyz);
#endif
#ifdef ASIDE_SAME_INDEX
  let otherStep = stepOf(u_toLocal() * local);
  return Line((beside + other * entry(origin + beside, other) - direction * t) * voxels, (other * otherStep - direction * tStep) * voxels);
#else
  return Line((beside + (other - direction) * t) * voxels, (other - direction) * tStep * voxels);
#endif
}

#if defined(FUNCTIONS) || defined(ANISOTROPY)
// Values of the harmonics along the ray.
var<private> harmonics: array<f32, 16>;

fn findHarmonics(d: vec3f) {
  let xx = d.x * d.x;
  let yy = d.y * d.y;
  let zz = d.z * d.z;
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
fn limited(color: vec3f) -> vec3f {
#if CLAMP == 1
  return max(color, vec3f(0.0));
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
var<private> brightnessEven: vec3f;
var<private> brightnessOdd: vec3f;
#endif

// A level's density along the ray.
fn densityAlong(level: i32, cell: Cell) -> f32 {
  let density = densityAt(level, cell);
  if ((u_levels(level).w & 1) == 0) { return density; }
  let low = directionalAt(level, 0, cell, vec4f(0.0));
  let high = directionalAt(level, 1, cell, vec4f(0.0, vec3f(u_empty(level).w)));
#ifdef BRIGHTNESS
  if ((levelOfPart(level) & 1) == 1) {
    brightnessOdd = high.yzw;
  } else {
    brightnessEven = high.yzw;
  }
#endif
  return max(density + dot(low, vec4f(harmonics[4], harmonics[5], harmonics[6], harmonics[7])) + high.x * harmonics[8], 0.0);
}
#endif

#ifdef BRIGHTNESS
// The ray's unit direction in the world.
var<private> along: vec3f;

// What a level adds to its logits of diffuse colour along the ray.
fn addedLogit(level: i32, stored: bool, cell: Cell) -> f32 {
  let has = u_levels(level).w;
  if ((has & 2) == 0) { return 0.0; }
  let empty = vec4f(u_empty(level).w);
  if (!stored) { return dot(along, empty.xyz); }
#ifdef ANISOTROPY
  if (has == 3) { return dot(along, select(brightnessEven, brightnessOdd, (levelOfPart(level) & 1) == 1)); }
  return dot(along, directionalAt(level, 1, cell, empty).yzw);
#else
  return dot(along, directionalAt(level, 0, cell, empty).xyz);
#endif
}
#endif

fn activate(color: ptr<function, array<vec4f, QUADS>>) {
#if defined(FUNCTIONS)
  var sum = vec3f(OFFSET);
  for (var number = 0; number < FUNCTIONS; number++) {
    for (var channel = 0; channel < 3; channel++) {
      let at = 3 * number + channel;
      sum[channel] += harmonics[number] * (*color)[at / 4][at % 4];
    }
  }
#ifdef CLAMP_SAMPLES
  sum = limited(sum);
#endif
  (*color)[0] = vec4f(sum, 0.0);
#elif !defined(LINEAR)
  for (var quad = 0; quad < QUADS; quad++) { (*color)[quad] = 1.0 / (1.0 + exp(-(*color)[quad])); }
#endif
}

// IEC 61966-2-1.
fn linear(display: vec3f) -> vec3f {
  return select(pow((display + 0.055) / 1.055, vec3f(2.4)), display / 12.92, display <= vec3f(0.04045));
}

fn levelTint(level: f32) -> vec3f {
  let x = f32(LAST_TINT) * level / max(f32(LEVELS - 1), 1.0);
  var tints = TINTS;
  let low = min(i32(x), LAST_TINT - 1);
  return mix(tints[low], tints[low + 1], x - f32(low));
}
