// One ray a fragment: `march.glsl` in WGSL.

// A fragment's colour, premultiplied, and depth.
struct Marched { color: vec4f, depth: f32 }

fn regionOf(last: f32) -> f32 {
#ifdef NESTED
  return regionLast;
#else
  return last;
#endif
}

fn shownPart(level: i32) -> i32 {
#ifdef NESTED
  return partOf(level);
#else
  return level;
#endif
}

fn marchRay(pixel: vec2f) -> Marched {
  middle = pixel;
  let camera = cameraDirection(pixel);
  let direction = u_toBox() * camera;
  let origin = u_origin() + u_toBox() * cameraStart(pixel);
  let t0 = entry(origin, direction);
  let local = u_toLocal() * camera;
  let tStep = stepOf(local);
  let intervalsOfStep = tStep * length(local) / u_interval();
  var start = origin + direction * t0;
  var perStep = direction * tStep;
  for (var i = 0; i < 2; i++) {
    // Rows go downward where the viewport's height is negative.
    let shift = select(vec2f(0.0, -sign(u_viewport().w) * u_halfPixel()), vec2f(u_halfPixel(), 0.0), i == 0);
    let line = aside(pixel + shift, t0, tStep, origin, direction);
    if (i == 0) { right = line; } else { below = line; }
  }

  // The first and the last sample inside, along every axis.
  var first = 0.0;
  var last = u_mostSteps();
  for (var axis = 0; axis < 3; axis++) {
    let low = u_lowest()[axis] - ON_FACE;
    let high = u_highest()[axis] + ON_FACE;
    if (perStep[axis] == 0.0) {
      if (start[axis] < low || start[axis] > high) { last = -1.0; }
      continue;
    }
    let a = (low - start[axis]) / perStep[axis];
    let b = (high - start[axis]) / perStep[axis];
    first = max(first, ceil(min(a, b)));
    last = min(last, max(a, b));
  }

#ifdef BRIGHTNESS
  along = normalize(u_toView() * camera);
#endif
#if defined(FUNCTIONS) || defined(ANISOTROPY)
  findHarmonics(normalize(u_toView() * camera));
#endif

  var sum: array<vec4f, QUADS>;
  var depth = 0.0;
  var reached = 0.0;
  var levels = 0.0;
  var weights = 0.0;
  var samples = 0;

  var constant = u_fixedLevel() >= 0.0;
  var lowest = i32(u_fixedLevel());
  var highest = lowest;
  var most = u_fixedLevel();
  var intervals = 1.0;
#ifdef NESTED
  rayAside = u_toBox() * cameraStart(pixel);
  rayDirection = direction;
  rayT = t0;
  rayStep = tStep;
  var cell: vec3f;
  var stepsPerBox: vec3f;
#else
  if (!constant) {
    for (var i = 0; i < 2; i++) { most = max(most, levelAt(select(last, first, i == 0))); }
    let least = min(most, levelOf(max(leastSquare(right, first, last), leastSquare(below, first, last))));
    constant = least == most;
    lowest = i32(least);
    highest = i32(ceil(most));
  }
#ifdef STEPS_BY_LEVEL
  // Of a ray whose samples are all of one level.
  intervals = exp2(most);
#endif
  // Of a macro cell, the edge in the box; of the box, the steps along each axis.
  let cell = 1.0 / u_macroScale(0);
  let stepsPerBox = 1.0 / perStep;
#endif
  var k = first;
  let enough = select(LARGEST, OPAQUE_DEPTH, u_skips());
  while (k <= last && depth < enough) {
#ifdef NESTED
    if (k > regionLast) {
      enterRegion(k, first, last);
      start = boxStart;
      perStep = boxStep;
      cell = 1.0 / u_macroScale(box);
      stepsPerBox = 1.0 / perStep;
      most = 0.0;
      for (var i = 0; i < 2; i++) { most = max(most, levelAt(select(regionLast, k, i == 0))); }
      var least = most;
      if (u_fixedLevel() < 0.0) {
        least = levelOf(max(leastSquare(right, k, regionLast), leastSquare(below, k, regionLast)));
        least = min(most, max(least, f32(box)));
      }
      constant = least == most;
      lowest = i32(least);
      highest = i32(ceil(most));
#ifdef STEPS_BY_LEVEL
      intervals = exp2(most);
#else
      intervals = exp2(f32(box));
#endif
    }
#endif
    var leaves = 0.0;
    var isFree = true;
    // Rays that a card marches together all come to matter before one of them samples.
    while (isFree && k <= regionOf(last)) {
      let position = clamp(start + k * perStep, vec3f(0.0), vec3f(1.0));
      let place = min(vec3i(position * u_macroScale(box)), u_macroCounts(box) - 1);
      var free = 0;
      if (u_skips()) { free = skipDistance(place, lowest, highest); }
      // Where the ray leaves the macro cells that this one speaks for.
      leaves = LARGEST;
      let reach = max(free, 1);
      for (var axis = 0; axis < 3; axis++) {
        if (perStep[axis] == 0.0) { continue; }
        let face = f32(select(place[axis] - reach + 1, place[axis] + reach, perStep[axis] > 0.0));
        leaves = min(leaves, (face * cell[axis] - start[axis]) * stepsPerBox[axis]);
      }
      isFree = free > 0;
      if (!isFree) { continue; }
#ifdef STEPS_BY_LEVEL
      if (!constant) {
        loop {
#ifdef NESTED
          k = entered(k, k + exp2(levelAt(k)));
#else
          k += exp2(levelAt(k));
#endif
          continuing { break if !(k < leaves && k <= regionOf(last)); }
        }
        continue;
      }
#endif
#ifdef NESTED
      let passed = max(ceil((min(leaves, regionEnd) - k) / intervals), 1.0) * intervals;
      k = entered(k + passed - intervals, k + passed);
#else
      k += max(ceil((min(leaves, last + 1.0) - k) / intervals), 1.0) * intervals;
#endif
    }
    if (isFree) {
#ifdef NESTED
      continue;
#else
      break;
#endif
    }
    loop {
      var lambda = most;
      if (!constant) { lambda = levelAt(k); }
      let position = clamp(start + k * perStep, vec3f(0.0), vec3f(1.0));
      let t = t0 + k * tStep;
#ifdef STEPS_BY_LEVEL
      var stands = exp2(lambda);
#else
      var stands = intervals;
#endif
#ifdef NESTED
      let sampled = k;
      k = entered(k, k + stands);
      if (isEntered) { stands = k - sampled; }
#else
      k += stands;
#endif
#ifdef MASKED
      // The mask is one of the smallest box.
      if (box == 0 && masked(position)) { continue; }
#endif
      samples++;
      let level = i32(lambda);
      let share = lambda - f32(level);
      let count = select(1, 2, share > 0.0);
      var fine = false;
      var coarse = false;
      var seen = false;
      // The cell of the finer one of two levels.
      var fineCell: Cell;
      // What is shown of the finer and the coarser level.
      var fineLevel = level;
      var coarseLevel = level + 1;
      var mixed = 0.0;
      for (var i = 0; i < count; i++) {
        if (i == 1) { fineCell = located; }
        var shown = level + i;
        var stored = false;
        loop {
#ifdef NESTED
          let part = partOf(shown);
          stored = locate(part, placeIn(boxOf(part), sampled));
#else
          stored = locate(shown, position);
#endif
#ifdef PARTIAL
          // What is not on the device is shown by the next coarser level that is.
          if (isAbsent && shown + 1 < LEVELS) {
            shown++;
            continue;
          }
#endif
          break;
        }
        if (i == 0) {
          fine = stored;
          fineLevel = shown;
        } else {
          coarse = stored;
          coarseLevel = shown;
        }
        var dense = shownPart(shown);
#ifdef SHARED_DENSITY
        // A level without density has level 0's.
        let own = located;
        if (u_levels(dense).y == 0) {
          if (i == 1 && (level == 0 || u_levels(level).y == 0)) { continue; }
          dense = 0;
          stored = locate(dense, position);
        }
#endif
        seen = seen || stored;
        var density = u_empty(dense).x;
#ifdef ANISOTROPY
        if (stored) { density = densityAlong(dense, located); }
#else
        if (stored) { density = densityAt(dense, located); }
#endif
#ifdef SHARED_DENSITY
        located = own;
#endif
#ifdef BLEND_AFTER
        density = opticalDepth(density, decodeOf(dense));
#ifdef NESTED
        density *= depthScale(dense);
#endif
#endif
        mixed += (density - mixed) * select(share, 1.0, i == 0);
      }
      if (!seen) { continue; }
#ifdef BLEND_AFTER
      var optical = mixed;
#else
      var optical = opticalDepth(mixed, decodeOf(level));
#endif
      optical *= stands * intervalsOfStep;
      let alpha = opacity(optical);
      if (alpha <= u_thresholds().x && u_skips()) { continue; }
      let weight = alpha * exp(-depth);
      depth += optical;
      weights += weight;
      reached += weight * t;
      levels += weight * lambda;
      if (weight > u_thresholds().y || !u_skips()) {
        // What has no value here keeps that of the sample before in SwiftShader.
        var color = array<vec4f, QUADS>();
        // The coarser one first, whose cell was located last.
        for (var i = count - 1; i >= 0; i--) {
          if (count == 2 && i == 0) { located = fineCell; }
          let part = select(select(share, 1.0 - share, i == 0), 1.0, count == 1);
          let stored = select(coarse, fine, i == 0);
          let shown = shownPart(select(coarseLevel, fineLevel, i == 0));
          var one: array<vec4f, QUADS>;
          colorAt(shown, stored, located, &one);
#ifdef BRIGHTNESS
          one[0] += vec4f(vec3f(addedLogit(shown, stored, located)), 0.0);
#endif
#ifdef BLEND_AFTER
          activate(&one);
#endif
          for (var quad = 0; quad < QUADS; quad++) { color[quad] += part * one[quad]; }
        }
#ifndef BLEND_AFTER
        activate(&color);
#endif
        for (var quad = 0; quad < QUADS; quad++) { sum[quad] += weight * color[quad]; }
      }
      continuing { break if !(k < leaves && k <= regionOf(last) && depth < enough); }
    }
  }

  let left = exp(-depth);
  var marched: Marched;
  var t = 0.0;
  // Where there is nothing, as far as depths go.
  marched.depth = u_farDepth();
  if (weights > 0.0) { t = reached / weights; }
  if (weights > 1e-3) {
    var written = u_depthOfT().x + u_depthOfT().y * select(1.0 / t, t, u_isParallel());
    if (u_logarithm().x > 0.0 && !u_isParallel()) { written = u_logarithm().x * log2(u_logarithm().y + u_logarithm().z * t); }
    marched.depth = clamp(written, 0.0, 1.0);
  }
  if (u_output() == STATISTICS) {
    marched.color = vec4f(f32(samples), f32(fetches), max(0.0, floor(last) - first + 1.0), 1.0);
    return marched;
  }
  if (u_output() == DISTANCE) {
    // Along the camera's axis, in units of the world.
    marched.color = vec4f(t, 1.0 - left, 0.0, 1.0);
    return marched;
  }
  var color = sum[0].xyz;
#if defined(FUNCTIONS) && !defined(CLAMP_SAMPLES)
  color = limited(color);
#endif
#ifdef NETWORK
  color += networkColor(normalize(u_toView() * camera), &sum);
#endif
  if (u_output() == LEVEL_COLORS && weights > 0.0) {
    let gray = dot(color, vec3f(0.3, 0.6, 0.1));
    color = mix(vec3f(gray), levelTint(levels / weights) * (1.0 - left), 0.6);
  }
  // Display-referred, as trained.
  if (u_linear()) { color = linear(max(color, vec3f(0.0))); }
  marched.color = vec4f(color, 1.0 - left);
  return marched;
}
