/* torch-ngp's CUDA parts for a processor: the grid of features, the march of rays through occupied
   cells, and the sums along them. One thread; the same order of operations in float32. */

#include <float.h>
#include <math.h>
#include <stdint.h>

static float limit(float value, float low, float high) { return fminf(high, fmaxf(low, value)); }

static uint32_t entry(uint32_t size, uint32_t resolution, const uint32_t node[3]) {
    uint32_t stride = 1, index = 0;
    for (int axis = 0; axis < 3 && stride <= size; axis++) {
        index += node[axis] * stride;
        stride *= resolution + 1;
    }
    if (stride > size) index = node[0] ^ node[1] * 2654435761u ^ node[2] * 805459861u;
    return index % size;
}

/* Outputs [levels, points, 2], or, with `back`, gradients of the table out of theirs. */
void grid(const float *points, const float *table, const int *offsets, float *values, int count,
          int levels, float log2_ratio, int base, float *back) {
    for (int level = 0; level < levels; level++) {
        const uint32_t size = offsets[level + 1] - offsets[level];
        const float scale = exp2f(level * log2_ratio) * base - 1.0f;
        const uint32_t resolution = (uint32_t)ceilf(scale) + 1;
        for (int n = 0; n < count; n++) {
            const float *at = points + 3 * n;
            float *value = values + 2 * ((int64_t)level * count + n), sum[2] = {0, 0}, part[3];
            uint32_t low[3];
            int outside = 0;
            for (int axis = 0; axis < 3; axis++) {
                outside |= at[axis] < 0 || at[axis] > 1;
                part[axis] = at[axis] * scale + 0.5f;
                low[axis] = (uint32_t)floorf(part[axis]);
                part[axis] -= low[axis];
            }
            for (int corner = 0; corner < 8 && !outside; corner++) {
                float weight = 1;
                uint32_t node[3];
                for (int axis = 0; axis < 3; axis++) {
                    const int high = corner >> axis & 1;
                    weight *= high ? part[axis] : 1 - part[axis];
                    node[axis] = low[axis] + high;
                }
                const int64_t index = 2 * (int64_t)(offsets[level] + entry(size, resolution, node));
                for (int c = 0; c < 2; c++) {
                    if (back) back[index + c] += weight * value[c];
                    else sum[c] += weight * table[index + c];
                }
            }
            if (!back) value[0] = sum[0], value[1] = sum[1];
        }
    }
}

static uint32_t spread(uint32_t v) {
    uint32_t out = 0;
    for (int bit = 0; bit < 10; bit++) out |= (v >> bit & 1) << 3 * bit;
    return out;
}

static uint32_t morton(uint32_t x, uint32_t y, uint32_t z) {
    return spread(x) | spread(y) << 1 | spread(z) << 2;
}

void to_morton(const int *cells, int *codes, int count) {
    for (int n = 0; n < count; n++) codes[n] = morton(cells[3 * n], cells[3 * n + 1], cells[3 * n + 2]);
}

void of_morton(const int *codes, int *cells, int count) {
    for (int n = 0; n < 3 * count; n++) {
        uint32_t cell = 0;
        for (int bit = 0; bit < 10; bit++) cell |= (codes[n / 3] >> (3 * bit + n % 3) & 1) << bit;
        cells[n] = cell;
    }
}

void near_far(const float *origins, const float *directions, const float *box, int count,
              float least, float *nears, float *fars) {
    for (int n = 0; n < count; n++) {
        float near = -FLT_MAX, far = FLT_MAX;
        for (int axis = 0; axis < 3; axis++) {
            const float inverse = 1 / directions[3 * n + axis], from = origins[3 * n + axis];
            const float a = (box[axis] - from) * inverse, b = (box[3 + axis] - from) * inverse;
            near = fmaxf(near, fminf(a, b));
            far = fminf(far, fmaxf(a, b));
        }
        const int missed = near > far;
        nears[n] = missed ? FLT_MAX : fmaxf(near, least);
        fars[n] = missed ? FLT_MAX : far;
    }
}

static int cube_of(float size, int cubes) {
    int exponent;
    frexpf(size, &exponent);
    return (int)fminf(cubes - 1, fmaxf(0, exponent));
}

/* At most `most` samples of one ray from `t`: positions, steps, and steps with the gaps before them.
   Returns their number. */
int march(const float *o, const float *d, const uint8_t *bits, float bound, float growth, int steps,
          int cubes, int side, float t, float far, int most, float *xyz, float *toward, float *delta) {
    const float least = 2 * 1.7320508075688772f / steps;
    const float longest = 2 * 1.7320508075688772f * (1 << (cubes - 1)) / side;
    float last = t;
    int found = 0;
    while (t < far && found < most) {
        float at[3], away = 0;
        for (int axis = 0; axis < 3; axis++) {
            at[axis] = limit(o[axis] + t * d[axis], -bound, bound);
            away = fmaxf(away, fabsf(at[axis]));
        }
        const float step = limit(t * growth, least, longest);
        const int a = cube_of(away, cubes), b = cube_of(step * side * 0.5f, cubes);
        const int level = a > b ? a : b;
        const float half = fminf(ldexpf(1, level), bound), inverse = 1 / half;
        int cell[3];
        for (int axis = 0; axis < 3; axis++)
            cell[axis] = (int)limit(0.5f * (at[axis] * inverse + 1) * side, 0, side - 1);
        const uint32_t index = level * side * side * side + morton(cell[0], cell[1], cell[2]);
        if (bits[index / 8] >> index % 8 & 1) {
            t += step;
            if (xyz) {
                for (int axis = 0; axis < 3; axis++) {
                    xyz[3 * found + axis] = at[axis];
                    toward[3 * found + axis] = d[axis];
                }
                delta[2 * found] = step;
                delta[2 * found + 1] = t - last;
            }
            last = t;
            found++;
            continue;
        }
        float ahead = FLT_MAX;
        for (int axis = 0; axis < 3; axis++) {
            const float face = (cell[axis] + 0.5f + 0.5f * copysignf(1, d[axis])) / side * 2 - 1;
            ahead = fminf(ahead, (face * half - at[axis]) / d[axis]);
        }
        const float end = t + fmaxf(0, ahead);
        do t += limit(t * growth, least, longest);
        while (t < end);
    }
    return found;
}

/* Sums of one ray in training, and the gradients of its samples if `back`. */
void composite(const float *sigma, const float *rgb, const float *delta, int count, float stop,
               float *weights, float *depth, float *image, int back, const float *to_weights,
               const float *to_image, float *to_sigma, float *to_rgb) {
    float left = 1, sum = 0, color[3] = {0, 0, 0}, t = 0, far = 0;
    for (int n = 0; n < count; n++) {
        const float alpha = 1 - expf(-sigma[n] * delta[2 * n]), weight = alpha * left;
        sum += weight;
        t += delta[2 * n + 1];
        far += weight * t;
        left *= 1 - alpha;
        float grown = back ? *to_weights * (1 - *weights) : 0;
        for (int c = 0; c < 3; c++) {
            color[c] += weight * rgb[3 * n + c];
            if (!back) continue;
            to_rgb[3 * n + c] = to_image[c] * weight;
            grown += to_image[c] * (left * rgb[3 * n + c] - (image[c] - color[c]));
        }
        if (back) to_sigma[n] = delta[2 * n] * grown;
        if (left < stop) break;
    }
    if (back) return;
    *weights = sum;
    *depth = far;
    for (int c = 0; c < 3; c++) image[c] = color[c];
}

/* Adds some samples of one ray to its sums in rendering. Returns 0 when the ray has ended. */
int add(const float *sigma, const float *rgb, const float *delta, int count, float stop, float *t,
        float *weights, float *depth, float *image) {
    for (int n = 0; n < count; n++) {
        if (delta[2 * n] == 0) return 0;
        const float left = 1 - *weights, alpha = 1 - expf(-sigma[n] * delta[2 * n]);
        const float weight = alpha * left;
        *weights += weight;
        *t += delta[2 * n + 1];
        *depth += weight * *t;
        for (int c = 0; c < 3; c++) image[c] += weight * rgb[3 * n + c];
        if (left < stop) return 0;
    }
    return 1;
}
