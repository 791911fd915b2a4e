// Boxes around each other: section 6 of formats/mipvog.md, "Nested boxes". It stands between `field.glsl` and `rays.glsl`.
//
// A ray is marched in regions, up to the next face of a box. A place in a box is found from that of the camera in the same box:
// as a share of the outermost box, it would have too few bits for a small one.

// Of each box, the smallest first: the camera as shares of it, and its edges in those of the outermost one.
uniform vec3 u_boxOrigin[BOXES];
uniform vec3 u_boxScale[BOXES];
// Voxels of level 0 along the outermost box.
uniform vec3 u_voxels;

// In shares of the outermost box, where a ray starts beside the camera, and its direction; t of sample 0, and between samples.
vec3 rayAside, rayDirection;
float rayT, rayStep;
// Sample 0 and the way between samples in the box of the region.
vec3 boxStart, boxStep;
// The last sample that may be in the region; where the next one begins, and whether that is a smaller box.
float regionLast = -1.0, regionEnd;
bool isEntered;

int boxOf(int part) {
  return part < LEVELS ? clamp(part - 1, 0, BOXES - 1) : part - LEVELS + 1;
}

// The part that shows a level in the region's box.
int partOf(int level) {
  return level == box && box > 0 ? LEVELS + box - 1 : level;
}

// A part's optical depths over one interval, of those that it stores.
float depthScale(int part) {
  return u_levels[part].z == 0 ? 1.0 : exp2(-float(boxOf(part)));
}

vec3 placeIn(int which, float k) {
  return clamp(u_boxOrigin[which] + (rayAside + rayDirection * (rayT + k * rayStep)) * u_boxScale[which], 0.0, 1.0);
}

// The first and the last number, which need not be whole, that lie in a box; none where the first is larger.
vec2 within(int which, float first, float last, out vec3 start, out vec3 perStep) {
  start = u_boxOrigin[which] + (rayAside + rayDirection * rayT) * u_boxScale[which];
  perStep = rayDirection * rayStep * u_boxScale[which];
  for (int axis = 0; axis < 3; axis++) {
    if (perStep[axis] == 0.0) {
      if (start[axis] < -ON_FACE || start[axis] > 1.0 + ON_FACE) first = LARGEST;
      continue;
    }
    float a = (-ON_FACE - start[axis]) / perStep[axis], b = (1.0 + ON_FACE - start[axis]) / perStep[axis];
    first = max(first, min(a, b));
    last = min(last, max(a, b));
  }
  return vec2(first, last);
}

// Begins the region of sample k: the smallest box that holds it, up to where the ray leaves it or enters a smaller one.
void enterRegion(float k, float first, float last) {
  box = BOXES - 1;
  isEntered = false;
  for (int which = BOXES - 1; which >= 0; which--) {
    vec3 start, perStep;
    vec2 range = within(which, first, last, start, perStep);
    if (which == BOXES - 1 || (range.x <= k && k <= range.y)) {
      box = which;
      boxStart = start;
      boxStep = perStep;
      isEntered = false;
      // The outermost box's own end may be beyond that of the samples.
      regionLast = which == BOXES - 1 ? last : range.y;
      regionEnd = regionLast < last ? regionLast : last + 1.0;
    } else if (!isEntered && range.x > k && range.x <= range.y) {
      isEntered = true;
      regionEnd = range.x;
      // The last number before it.
      regionLast = uintBitsToFloat(floatBitsToUint(regionEnd) - 1u);
    }
  }
}

// The number after k, where it would be `next`: what stands at a face is not stepped over.
float entered(float k, float next) {
  return isEntered && next > regionEnd ? k + min(max(ceil(regionEnd - k), 1.0), next - k) : next;
}
