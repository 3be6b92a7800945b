// The compositing kernels once more in C++, as what a compiler on the user's machine would give.
//
// The design of docs/why/gaussians.md#the-cpu-rasteriser before its last two steps: tiles of 4x4-pixel blocks, one 16-lane vector a
// block, whitened coordinates, prefetching, front-to-back gradients with one running number a pixel, one slot an
// entry. It tests each block by its pixels, where ours tests sixteen blocks at once and keeps the bits for backward.
// tools/bench/raster.py compiles this with g++ -O3 -march=native and compares.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#ifdef __AVX512F__
#include <immintrin.h>
#endif
#include <thread>
#include <vector>

namespace {

constexpr int kSide = 4, kLanes = 16, kMoments = 6;
typedef float Lanes __attribute__((vector_size(64)));
const Lanes kColumns = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
const Lanes kRows = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

struct Record { float column, row, l11, l21, l22, opacity, half_width, half_height; };
struct Rules { float alpha_max, alpha_floor, stop; };

inline Lanes all(float value) { return value - Lanes{}; }
#ifdef __AVX512F__
// Through intrinsics: g++ 12 takes vector masks apart lane by lane.
typedef __mmask16 Mask;
inline Mask at_most(Lanes a, Lanes b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ); }
inline Mask below(Lanes a, Lanes b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ); }
inline Lanes choose(Mask m, Lanes a, Lanes b) { return (Lanes)_mm512_mask_blend_ps(m, (__m512)b, (__m512)a); }
inline Lanes lower(Lanes a, Lanes b) { return (Lanes)_mm512_min_ps((__m512)a, (__m512)b); }
inline bool any(Mask mask) { return mask != 0; }
inline float sum(Lanes v) { return _mm512_reduce_add_ps((__m512)v); }
#else
typedef int32_t Mask __attribute__((vector_size(64)));
inline Mask at_most(Lanes a, Lanes b) { return a <= b; }
inline Mask below(Lanes a, Lanes b) { return a < b; }
inline Lanes choose(Mask m, Lanes a, Lanes b) { return m ? a : b; }
inline Lanes lower(Lanes a, Lanes b) { return a < b ? a : b; }
inline bool any(Mask mask) {
    int64_t words[8];
    std::memcpy(words, &mask, sizeof words);
    int64_t found = 0;
    for (int64_t word : words) found |= word;
    return found != 0;
}
inline float sum(Lanes v) {
    for (int half = 8; half >= 1; half /= 2)
        for (int lane = 0; lane < half; lane++) v[lane] += v[lane + half];
    return v[0];
}
#endif

inline Lanes exp_minus(Lanes s) {
    Lanes x = lower(s, all(5.6f)) * 0.125f;
    Lanes p = -0.0059069996f * x + 0.039882693f;
    p = p * x - 0.16604707f;
    p = p * x + 0.49990377f;
    p = p * x - 0.99999505f;
    p = p * x + 1.0f;
    p *= p;
    p *= p;
    return p * p;
}

struct Tile {
    int left, top, across, down, most;
    Tile(int number, int width, int height, int tile) {
        const int tiles = (width + tile - 1) / tile;
        left = number % tiles * tile;
        top = number / tiles * tile;
        most = tile / kSide;
        across = std::min(most, (width - left + kSide - 1) / kSide);
        down = std::min(most, (height - top + kSide - 1) / kSide);
    }
};

// Ask for a Gaussian's record before its turn comes.
inline void ask(int64_t entry, int64_t end, const int32_t* entries, const Record* records, const float* values, int c) {
    const int64_t ahead = entries[std::min(entry + 8, end - 1)];
    __builtin_prefetch(&records[ahead]);
    __builtin_prefetch(values + c * ahead);
}

// What a Gaussian means to one tile.
struct Splat {
    Lanes slope_u, slope_v;
    float x, y, l11, l21, l22, opacity, farthest;
    int x0, x1, y0, y1;
    Splat(const Record& g, const Tile& t, const Rules& rules) {
        x = g.column - t.left, y = g.row - t.top;
        l11 = g.l11, l21 = g.l21, l22 = g.l22, opacity = g.opacity;
        farthest = std::log(opacity / rules.alpha_floor) + 1e-5f;
        slope_u = kColumns * l11 + kRows * l21;
        slope_v = kRows * l22;
        x0 = std::max(0, (int)std::ceil(x - g.half_width)) / kSide;
        x1 = std::min(t.across - 1, (int)std::floor((std::floor(x + g.half_width)) / kSide));
        y0 = std::max(0, (int)std::ceil(y - g.half_height)) / kSide;
        y1 = std::min(t.down - 1, (int)std::floor((std::floor(y + g.half_height)) / kSide));
    }
    void at(int bx, int by, Lanes& u, Lanes& v) const {
        const float dx = kSide * bx - x, dy = kSide * by - y;
        u = slope_u + (l11 * dx + l21 * dy);
        v = slope_v + l22 * dy;
    }
};

struct Hit { Lanes before, raw, alpha, weight; Mask drawn; };

inline Hit hit(Lanes s, Mask near, const Splat& g, const Rules& rules, Lanes& light) {
    Hit h;
    h.before = light;
    h.raw = g.opacity * exp_minus(s);
    h.alpha = lower(h.raw, all(rules.alpha_max));
    const Lanes after = h.before * (1.0f - h.alpha);
    const Mask open = near & at_most(all(rules.alpha_floor), h.raw) & below(Lanes{}, h.before);
    h.drawn = open & below(all(rules.stop), after);
    h.weight = choose(h.drawn, h.alpha * h.before, Lanes{});
    light = choose(h.drawn, after, choose(open, -h.before, h.before));
    return h;
}

template <int C>
void forward(std::atomic<int>& ticket, int tiles, const int64_t* order, const Record* records, const float* values,
             int width, int height, int tile, const int64_t* starts, const int32_t* entries, Rules rules, float* out,
             float* left_over) {
    const int most = tile / kSide;
    std::vector<Lanes> state((size_t)most * most * (1 + C));
    std::vector<char> finished(most * most);
    for (int turn; (turn = ticket++) < tiles;) {
        const int number = order[turn];
        const Tile t(number, width, height, tile);
        std::fill(state.begin(), state.end(), Lanes{});
        std::fill(finished.begin(), finished.end(), 0);
        for (int block = 0; block < most * most; block++) state[block * (1 + C)] = all(1.0f);
        int unfinished = t.across * t.down;
        for (int64_t entry = starts[number]; entry < starts[number + 1] && unfinished; entry++) {
            ask(entry, starts[number + 1], entries, records, values, C);
            const Splat g(records[entries[entry]], t, rules);
            const float* colour = values + (size_t)C * entries[entry];
            for (int by = g.y0; by <= g.y1; by++)
                for (int bx = g.x0; bx <= g.x1; bx++) {
                    const int block = by * most + bx;
                    if (finished[block]) continue;
                    Lanes u, v;
                    g.at(bx, by, u, v);
                    const Lanes s = u * u + v * v;
                    const Mask near = at_most(s, all(g.farthest));
                    if (!any(near)) continue;
                    Lanes* here = &state[block * (1 + C)];
                    const Hit h = hit(s, near, g, rules, here[0]);
                    _Pragma("GCC unroll 32") for (int c = 0; c < C; c++) here[1 + c] += h.weight * colour[c];
                    if (!any(below(Lanes{}, here[0]))) finished[block] = 1, unfinished--;
                }
        }
        for (int row = t.top; row < std::min(t.top + tile, height); row++)
            for (int column = t.left; column < std::min(t.left + tile, width); column++) {
                const int x = column - t.left, y = row - t.top, lane = y % kSide * kSide + x % kSide;
                const Lanes* here = &state[(y / kSide * most + x / kSide) * (1 + C)];
                const size_t pixel = (size_t)row * width + column;
                left_over[pixel] = std::fabs(here[0][lane]);
                _Pragma("GCC unroll 32") for (int c = 0; c < C; c++) out[pixel * C + c] = here[1 + c][lane];
            }
    }
}

template <int C>
void backward(std::atomic<int>& ticket, int tiles, const int64_t* order, const Record* records, const float* values,
              int width, int height, int tile, const int64_t* starts, const int32_t* entries, Rules rules,
              const int32_t* slot_of, const float* out, const float* left_over, const float* d_out,
              const float* d_left_over, float* slots, int stride) {
    const int most = tile / kSide;
    std::vector<Lanes> state((size_t)most * most * (2 + C));
    std::vector<char> finished(most * most);
    for (int turn; (turn = ticket++) < tiles;) {
        const int number = order[turn];
        const Tile t(number, width, height, tile);
        std::fill(state.begin(), state.end(), Lanes{});
        std::fill(finished.begin(), finished.end(), 0);
        for (int block = 0; block < most * most; block++) state[block * (2 + C)] = all(1.0f);
        for (int row = t.top; row < std::min(t.top + tile, height); row++)
            for (int column = t.left; column < std::min(t.left + tile, width); column++) {
                const int x = column - t.left, y = row - t.top, lane = y % kSide * kSide + x % kSide;
                Lanes* here = &state[(y / kSide * most + x / kSide) * (2 + C)];
                const size_t pixel = (size_t)row * width + column;
                float to_come = d_left_over[pixel] * left_over[pixel];
                _Pragma("GCC unroll 32") for (int c = 0; c < C; c++) {
                    here[2 + c][lane] = d_out[pixel * C + c];
                    to_come += d_out[pixel * C + c] * out[pixel * C + c];
                }
                here[1][lane] = to_come;
            }
        int unfinished = t.across * t.down;
        for (int64_t entry = starts[number]; entry < starts[number + 1]; entry++) {
            float* slot = slots + (size_t)stride * slot_of[entry];
            Lanes sums[kMoments + C] = {};
            if (unfinished) {
                ask(entry, starts[number + 1], entries, records, values, C);
                const Splat g(records[entries[entry]], t, rules);
                const float* colour = values + (size_t)C * entries[entry];
                for (int by = g.y0; by <= g.y1; by++)
                    for (int bx = g.x0; bx <= g.x1; bx++) {
                        const int block = by * most + bx;
                        if (finished[block]) continue;
                        Lanes u, v;
                        g.at(bx, by, u, v);
                        const Lanes s = u * u + v * v;
                        const Mask near = at_most(s, all(g.farthest));
                        if (!any(near)) continue;
                        Lanes* here = &state[block * (2 + C)];
                        const Hit h = hit(s, near, g, rules, here[0]);
                        if (!any(below(Lanes{}, here[0]))) finished[block] = 1, unfinished--;
                        Lanes pull = {};
                        _Pragma("GCC unroll 32") for (int c = 0; c < C; c++) {
                            pull += here[2 + c] * colour[c];
                            sums[kMoments + c] += h.weight * here[2 + c];
                        }
                        here[1] -= h.weight * pull;
                        const Lanes d_alpha = h.before * pull - here[1] / (1.0f - h.alpha);
                        const Lanes ds = choose(h.drawn & below(h.raw, all(rules.alpha_max)), -h.alpha * d_alpha, Lanes{});
                        const Lanes ds_u = ds * u, ds_v = ds * v;
                        sums[0] += ds, sums[1] += ds_u, sums[2] += ds_v;
                        sums[3] += ds_u * u, sums[4] += ds_u * v, sums[5] += ds_v * v;
                    }
            }
            for (int k = 0; k < kMoments + C; k++) slot[k] = sum(sums[k]);
        }
    }
}

template <class Job>
void together(int threads, Job job) {
    std::atomic<int> ticket{0};
    std::vector<std::thread> others;
    for (int k = 1; k < threads; k++) others.emplace_back([&] { job(ticket); });
    job(ticket);
    for (std::thread& other : others) other.join();
}

}  // namespace

#define FOR_CHANNELS(CALL) \
    switch (channels) {    \
        case 3: CALL(3);   \
        case 4: CALL(4);   \
        case 19: CALL(19); \
        case 20: CALL(20); \
        default: return 1; \
    }

extern "C" int composite(int channels, int threads, int tiles, const int64_t* order, const float* records,
                         const float* values, int width, int height, int tile, const int64_t* starts,
                         const int32_t* entries, const float* rules, float* out, float* left_over) {
    const Rules given{rules[0], rules[1], rules[2]};
    const Record* all_records = reinterpret_cast<const Record*>(records);
#define RUN(C)                                                                                                      \
    together(threads, [&](std::atomic<int>& ticket) {                                                               \
        forward<C>(ticket, tiles, order, all_records, values, width, height, tile, starts, entries, given, out,     \
                   left_over);                                                                                      \
    });                                                                                                             \
    return 0
    FOR_CHANNELS(RUN)
#undef RUN
}

extern "C" int composite_backward(int channels, int threads, int tiles, const int64_t* order, const float* records,
                                  const float* values, int width, int height, int tile, const int64_t* starts,
                                  const int32_t* entries, const float* rules, const int32_t* slot_of, const float* out,
                                  const float* left_over, const float* d_out, const float* d_left_over, float* slots,
                                  int stride) {
    const Rules given{rules[0], rules[1], rules[2]};
    const Record* all_records = reinterpret_cast<const Record*>(records);
#define RUN(C)                                                                                                       \
    together(threads, [&](std::atomic<int>& ticket) {                                                                \
        backward<C>(ticket, tiles, order, all_records, values, width, height, tile, starts, entries, given, slot_of, \
                    out, left_over, d_out, d_left_over, slots, stride);                                              \
    });                                                                                                              \
    return 0
    FOR_CHANNELS(RUN)
#undef RUN
}
