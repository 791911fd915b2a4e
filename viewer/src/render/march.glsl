// One ray a fragment, marched as section 6 of formats/mipvog.md says and as src/render of the reference renderer does. It
// follows `rays.glsl`.
//
// Functions are made a part of each place that calls them, and drivers take longer to compile the more there is. So what is
// done for two levels, or for two ends of a ray, is a loop, which has one place.

void main() {
  vec3 camera = cameraDirection(gl_FragCoord.xy);
  vec3 direction = u_toBox * camera;
  vec3 origin = u_origin + u_toBox * cameraStart(gl_FragCoord.xy);
  float t0 = entry(origin, direction);
  vec3 local = u_toLocal * camera;
  float tStep = stepOf(local);
  float intervalsOfStep = tStep * length(local) / u_interval;
  vec3 start = origin + direction * t0;
  vec3 perStep = direction * tStep;
  for (int i = 0; i < 2; i++) {
    vec2 shift = i == 0 ? vec2(u_halfPixel, 0.0) : vec2(0.0, -u_halfPixel);
    Line line = aside(gl_FragCoord.xy + shift, t0, tStep, origin, direction);
    if (i == 0) right = line;
    else below = line;
  }

  // The first and the last sample inside, along every axis.
  float first = 0.0, last = u_mostSteps;
  for (int axis = 0; axis < 3; axis++) {
    if (perStep[axis] == 0.0) {
      if (start[axis] < u_lowest[axis] - ON_FACE || start[axis] > u_highest[axis] + ON_FACE) last = -1.0;
      continue;
    }
    float a = (u_lowest[axis] - ON_FACE - start[axis]) / perStep[axis];
    float b = (u_highest[axis] + ON_FACE - start[axis]) / perStep[axis];
    first = max(first, ceil(min(a, b)));
    last = min(last, max(a, b));
  }

#ifdef BRIGHTNESS
  along = normalize(u_toView * camera);
#endif
#if defined(FUNCTIONS) || defined(ANISOTROPY)
  findHarmonics(normalize(u_toView * camera));
#endif

  vec4 sum[QUADS];
  for (int quad = 0; quad < QUADS; quad++) sum[quad] = vec4(0.0);
  float depth = 0.0, reached = 0.0, levels = 0.0, weights = 0.0;
  int samples = 0;

  bool constant = u_fixedLevel >= 0.0;
  ivec2 range = ivec2(int(u_fixedLevel));
  float most = u_fixedLevel;
#ifdef NESTED
  rayAside = u_toBox * cameraStart(gl_FragCoord.xy);
  rayDirection = direction;
  rayT = t0;
  rayStep = tStep;
  float intervals;
  vec3 cell, stepsPerBox;
#else
  if (!constant) {
    for (int i = 0; i < 2; i++) most = max(most, levelAt(i == 0 ? first : last));
    float least = min(most, levelOf(max(leastSquare(right, first, last), leastSquare(below, first, last))));
    constant = least == most;
    range = ivec2(int(least), int(ceil(most)));
  }

#ifdef STEPS_BY_LEVEL
  // Of a ray whose samples are all of one level.
  float intervals = exp2(most);
#else
  const float intervals = 1.0;
#endif
  // Of a macro cell, the edge in the box; of the box, the steps along each axis.
  vec3 cell = 1.0 / u_macroScale, stepsPerBox = 1.0 / perStep;
#endif
  float k = first;
  float enough = u_skips ? OPAQUE_DEPTH : LARGEST;
  while (k <= last && depth < enough) {
#ifdef NESTED
    if (k > regionLast) {
      enterRegion(k, first, last);
      start = boxStart;
      perStep = boxStep;
      cell = 1.0 / MACRO_SCALE;
      stepsPerBox = 1.0 / perStep;
      most = 0.0;
      for (int i = 0; i < 2; i++) most = max(most, levelAt(i == 0 ? k : regionLast));
      float least = levelOf(max(leastSquare(right, k, regionLast), leastSquare(below, k, regionLast)));
      least = u_fixedLevel >= 0.0 ? most : min(most, max(least, float(box)));
      constant = least == most;
      range = ivec2(int(least), int(ceil(most)));
#ifdef STEPS_BY_LEVEL
      intervals = exp2(most);
#else
      intervals = exp2(float(box));
#endif
    }
#endif
    vec3 position;
    float leaves;
    bool isFree = true;
    // Rays that a card marches together all come to matter before one of them samples.
    while (isFree && k <= REGION_LAST) {
      position = clamp(start + k * perStep, 0.0, 1.0);
      ivec3 place = min(ivec3(position * MACRO_SCALE), MACRO_COUNTS - 1);
      int free = u_skips ? skipDistance(place, range) : 0;
      // Where the ray leaves the macro cells that this one speaks for.
      leaves = LARGEST;
      int reach = max(free, 1);
      for (int axis = 0; axis < 3; axis++) {
        if (perStep[axis] == 0.0) continue;
        float face = float(perStep[axis] > 0.0 ? place[axis] + reach : place[axis] - reach + 1);
        leaves = min(leaves, (face * cell[axis] - start[axis]) * stepsPerBox[axis]);
      }
      isFree = free > 0;
      if (!isFree) continue;
#ifdef STEPS_BY_LEVEL
      if (!constant) {
#ifdef NESTED
        do k = entered(k, k + exp2(levelAt(k))); while (k < leaves && k <= regionLast);
#else
        do k += exp2(levelAt(k)); while (k < leaves && k <= last);
#endif
        continue;
      }
#endif
#ifdef NESTED
      float passed = max(ceil((min(leaves, regionEnd) - k) / intervals), 1.0) * intervals;
      k = entered(k + passed - intervals, k + passed);
#else
      k += max(ceil((min(leaves, last + 1.0) - k) / intervals), 1.0) * intervals;
#endif
    }
#ifdef NESTED
    if (isFree) continue;
#else
    if (isFree) break;
#endif
    do {
      float lambda = constant ? most : levelAt(k);
      position = clamp(start + k * perStep, 0.0, 1.0);
      float t = t0 + k * tStep;
#ifdef STEPS_BY_LEVEL
      float stands = exp2(lambda);
#elif defined(NESTED)
      float stands = intervals;
#else
      const float stands = 1.0;
#endif
#ifdef NESTED
      float sampled = k;
      k = entered(k, k + stands);
      if (isEntered) stands = k - sampled;
#else
      k += stands;
#endif
#ifdef MASKED
#ifdef NESTED
      // The mask is one of the smallest box.
      if (box == 0 && masked(position)) continue;
#else
      if (masked(position)) continue;
#endif
#endif
      samples++;
      int level = int(lambda);
      float share = lambda - float(level);
      int count = share > 0.0 ? 2 : 1;
      bool fine = false, coarse = false, seen = false;
      // The cell of the finer one of two levels.
      Cell fineCell;
#ifdef PARTIAL
      int fineLevel = level, coarseLevel = level + 1;
#endif
      float mixed = 0.0;
      for (int i = 0; i < count; i++) {
        if (i == 1) fineCell = located;
#ifdef PARTIAL
        // What is not on the device is shown by the next coarser level that is.
        int shown = level + i;
        bool stored;
        for (; ; shown++) {
          stored = locate(PART(shown), PLACE(PART(shown)));
          if (!isAbsent || shown + 1 >= LEVELS) break;
        }
        if (i == 0) fineLevel = shown;
        else coarseLevel = shown;
#else
        bool stored = locate(PART(level + i), PLACE(PART(level + i)));
#endif
        if (i == 0) fine = stored;
        else coarse = stored;
        int dense = SHOWN(i);
#ifdef SHARED_DENSITY
        // A level without density has level 0's.
        Cell own = located;
        if (u_levels[dense].y == 0) {
          if (i == 1 && (level == 0 || u_levels[level].y == 0)) continue;
          dense = 0;
          stored = locate(dense, position);
        }
#endif
        seen = seen || stored;
#ifdef ANISOTROPY
        float density = stored ? densityAlong(dense, located) : u_empty[dense].x;
#else
        float density = stored ? densityAt(dense, located) : u_empty[dense].x;
#endif
#ifdef SHARED_DENSITY
        located = own;
#endif
#ifdef BLEND_AFTER
        density = opticalDepth(density, DECODE_OF(dense));
#ifdef NESTED
        density *= depthScale(dense);
#endif
#endif
        mixed += (density - mixed) * (i == 0 ? 1.0 : share);
      }
      if (!seen) continue;
#ifdef BLEND_AFTER
      float optical = mixed;
#else
      float optical = opticalDepth(mixed, DECODE_OF(level));
#endif
      optical *= stands * intervalsOfStep;
      float alpha = opacity(optical);
      if (alpha <= u_thresholds.x && u_skips) continue;
      float weight = alpha * exp(-depth);
      depth += optical;
      weights += weight;
      reached += weight * t;
      levels += weight * lambda;
      if (weight > u_thresholds.y || !u_skips) {
        vec4 color[QUADS];
        for (int quad = 0; quad < QUADS; quad++) color[quad] = vec4(0.0);
        // The coarser one first, whose cell was located last.
        for (int i = count - 1; i >= 0; i--) {
          if (count == 2 && i == 0) located = fineCell;
          float part = count == 1 ? 1.0 : i == 0 ? 1.0 - share : share;
          vec4 one[QUADS];
          colorAt(SHOWN(i), i == 0 ? fine : coarse, located, one);
#ifdef BRIGHTNESS
          one[0].xyz += addedLogit(SHOWN(i), i == 0 ? fine : coarse, located);
#endif
#ifdef BLEND_AFTER
          activate(one);
#endif
          for (int quad = 0; quad < QUADS; quad++) color[quad] += part * one[quad];
        }
#ifndef BLEND_AFTER
        activate(color);
#endif
        for (int quad = 0; quad < QUADS; quad++) sum[quad] += weight * color[quad];
      }
    } while (k < leaves && k <= REGION_LAST && depth < enough);
  }

  float left = exp(-depth);
  float t = weights > 0.0 ? reached / weights : 0.0;
  // Where there is nothing, as far as depths go.
  float written = u_depthOfT.x + u_depthOfT.y * (u_isParallel ? t : 1.0 / t);
  if (u_logarithm.x > 0.0 && !u_isParallel) written = u_logarithm.x * log2(u_logarithm.y + u_logarithm.z * t);
  gl_FragDepth = weights > 1e-3 ? clamp(written, 0.0, 1.0) : u_farDepth;
  if (u_output == STATISTICS) {
    fragment = vec4(float(samples), float(fetches), max(0.0, floor(last) - first + 1.0), 1.0);
    return;
  }
  if (u_output == DISTANCE) {
    // Along the camera's axis, in units of the world.
    fragment = vec4(t, 1.0 - left, 0.0, 1.0);
    return;
  }
  vec3 color = sum[0].xyz;
#if defined(FUNCTIONS) && !defined(CLAMP_SAMPLES)
  color = limited(color);
#endif
#ifdef NETWORK
  color += networkColor(normalize(u_toView * camera), sum);
#endif
  if (u_output == LEVEL_COLORS && weights > 0.0) {
    float gray = dot(color, vec3(0.3, 0.6, 0.1));
    color = mix(vec3(gray), levelTint(levels / weights) * (1.0 - left), 0.6);
  }
  // Display-referred, as trained.
  fragment = vec4(u_linear ? linear(max(color, 0.0)) : color, 1.0 - left);
}
