// Boxes around each other: `nested.glsl` in WGSL.

// In shares of the outermost box, where a ray starts beside the camera, and its direction; t of sample 0, and between samples.
var<private> rayAside: vec3f;
var<private> rayDirection: vec3f;
var<private> rayT: f32;
var<private> rayStep: f32;
// Sample 0 and the way between samples in the box of the region.
var<private> boxStart: vec3f;
var<private> boxStep: vec3f;
// The last sample that may be in the region; where the next one begins, and whether that is a smaller box.
var<private> regionLast: f32 = -1.0;
var<private> regionEnd: f32;
var<private> isEntered: bool;

fn boxOf(part: i32) -> i32 {
  return select(part - LEVELS + 1, clamp(part - 1, 0, BOXES - 1), part < LEVELS);
}

// The part that shows a level in the region's box.
fn partOf(level: i32) -> i32 {
  return select(level, LEVELS + box - 1, level == box && box > 0);
}

// A part's optical depths over one interval, of those that it stores.
fn depthScale(part: i32) -> f32 {
  return select(exp2(-f32(boxOf(part))), 1.0, u_levels(part).z == 0);
}

fn placeIn(which: i32, k: f32) -> vec3f {
  return clamp(u_boxOrigin(which) + (rayAside + rayDirection * (rayT + k * rayStep)) * u_boxScale(which), vec3f(0.0), vec3f(1.0));
}

// The first and the last number, which need not be whole, that lie in a box; none where the first is larger.
struct Within { first: f32, last: f32, start: vec3f, perStep: vec3f }

fn within(which: i32, lowest: f32, highest: f32) -> Within {
  let start = u_boxOrigin(which) + (rayAside + rayDirection * rayT) * u_boxScale(which);
  let perStep = rayDirection * rayStep * u_boxScale(which);
  var first = lowest;
  var last = highest;
  for (var axis = 0; axis < 3; axis++) {
    if (perStep[axis] == 0.0) {
      if (start[axis] < -ON_FACE || start[axis] > 1.0 + ON_FACE) { first = LARGEST; }
      continue;
    }
    let a = (-ON_FACE - start[axis]) / perStep[axis];
    let b = (1.0 + ON_FACE - start[axis]) / perStep[axis];
    first = max(first, min(a, b));
    last = min(last, max(a, b));
  }
  return Within(first, last, start, perStep);
}

// Begins the region of sample k: the smallest box that holds it, up to where the ray leaves it or enters a smaller one.
fn enterRegion(k: f32, first: f32, last: f32) {
  box = BOXES - 1;
  isEntered = false;
  for (var which = BOXES - 1; which >= 0; which--) {
    let range = within(which, first, last);
    if (which == BOXES - 1 || (range.first <= k && k <= range.last)) {
      box = which;
      boxStart = range.start;
      boxStep = range.perStep;
      isEntered = false;
      // The outermost box's own end may be beyond that of the samples.
      regionLast = select(range.last, last, which == BOXES - 1);
      regionEnd = select(last + 1.0, regionLast, regionLast < last);
    } else if (!isEntered && range.first > k && range.first <= range.last) {
      isEntered = true;
      regionEnd = range.first;
      // The last number before it.
      regionLast = bitcast<f32>(bitcast<u32>(regionEnd) - 1u);
    }
  }
}

// The number after k, where it would be `next`: what stands at a face is not stepped over.
fn entered(k: f32, next: f32) -> f32 {
  return select(next, k + min(max(ceil(regionEnd - k), 1.0), next - k), isEntered && next > regionEnd);
}
