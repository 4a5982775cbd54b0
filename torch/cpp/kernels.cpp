#include "kernels.hpp"

#include <cmath>
#include <cstring>

namespace m4gn
{
namespace M4GN_ISA
{
namespace
{

inline float load(float x) { return x; }

inline float load(uint16_t x)
{
    const uint32_t bits = uint32_t(x) << 16;
    float f;
    std::memcpy(&f, &bits, 4);
    return f;
}

inline void store(float x, float& to) { to = x; }

// Round to nearest, ties to even; NaN as arithmetic makes it stays NaN.
inline void store(float x, uint16_t& to)
{
    uint32_t bits;
    std::memcpy(&bits, &x, 4);
    to = uint16_t((bits + 0x7fff + ((bits >> 16) & 1)) >> 16);
}

// W: the width where it is known when compiling, 0 otherwise.
template<class T, int W>
void edgeInput(
    int64_t edges, int64_t width, const T* a, const T* ends, const int64_t* senders, const int64_t* receivers,
    T* y)
{
    const int64_t d = W ? W : width;
    for (int64_t e = 0; e < edges; ++e)
    {
        const T* __restrict__ row = a + e * d;
        const T* __restrict__ from = ends + 2 * d * senders[e];
        const T* __restrict__ to = ends + 2 * d * receivers[e] + d;
        T* __restrict__ out = y + e * d;
        #pragma omp simd
        for (int64_t i = 0; i < d; ++i)
        {
            const float x = load(row[i]) + load(from[i]) + load(to[i]);
            store(x > 0 ? x : (x <= 0 ? 0.0f : x), out[i]);
        }
    }
}

template<class T, int W>
void edgeInputBackward(
    int64_t edges, int64_t width, const T* dy, const T* y, const int64_t* senders, const int64_t* receivers,
    T* dx, float* dends)
{
    const int64_t d = W ? W : width;
    for (int64_t e = 0; e < edges; ++e)
    {
        const T* __restrict__ g = dy + e * d;
        const T* __restrict__ out = y + e * d;
        T* __restrict__ in = dx + e * d;
        float* __restrict__ from = dends + 2 * d * senders[e];
        float* __restrict__ to = dends + 2 * d * receivers[e] + d;
        #pragma omp simd
        for (int64_t i = 0; i < d; ++i)
        {
            const float v = load(out[i]) > 0 ? load(g[i]) : 0.0f;
            store(v, in[i]);
            from[i] += v;
            to[i] += v;
        }
    }
}

template<class T, int W>
void normForward(
    int64_t rows, int64_t width, const float* residual, const T* x, const float* scale, const float* shift,
    const int64_t* receivers, float* out, T* copy, float* sums, float* meanRstd)
{
    const int64_t d = W ? W : width;
    for (int64_t r = 0; r < rows; ++r)
    {
        const T* __restrict__ in = x + r * d;
        float* __restrict__ to = out + r * d;
        float sum = 0, square = 0;
        #pragma omp simd reduction(+ : sum)
        for (int64_t i = 0; i < d; ++i) sum += load(in[i]);
        const float mean = sum / float(d);
        #pragma omp simd reduction(+ : square)
        for (int64_t i = 0; i < d; ++i)
        {
            const float c = load(in[i]) - mean;
            square += c * c;
        }
        const float rstd = 1.0f / std::sqrt(square / float(d) + 1e-5f);
        meanRstd[2 * r] = mean;
        meanRstd[2 * r + 1] = rstd;
        if (residual)
        {
            const float* __restrict__ old = residual + r * d;
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) to[i] = old[i] + ((load(in[i]) - mean) * rstd * scale[i] + shift[i]);
        }
        else
        {
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) to[i] = (load(in[i]) - mean) * rstd * scale[i] + shift[i];
        }
        if (copy)
        {
            T* __restrict__ c = copy + r * d;
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) store(to[i], c[i]);
        }
        if (receivers)
        {
            float* __restrict__ s = sums + receivers[r] * d;
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) s[i] += to[i];
        }
    }
}

template<class T, int W>
void normBackward(
    int64_t rows, int64_t width, const float* dout, const T* dcopy, const T* dsums, const int64_t* receivers,
    const T* x, const float* scale, const float* meanRstd, float* g, T* dx, float* dscale, float* dshift)
{
    const int64_t d = W ? W : width;
    for (int64_t r = 0; r < rows; ++r)
    {
        float* __restrict__ grad = g + r * d;
        const T* __restrict__ in = x + r * d;
        T* __restrict__ to = dx + r * d;
        if (dout) std::memcpy(grad, dout + r * d, d * sizeof(float));
        else std::memset(grad, 0, d * sizeof(float));
        if (dcopy)
        {
            const T* __restrict__ c = dcopy + r * d;
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) grad[i] += load(c[i]);
        }
        if (dsums)
        {
            const T* __restrict__ s = dsums + receivers[r] * d;
            #pragma omp simd
            for (int64_t i = 0; i < d; ++i) grad[i] += load(s[i]);
        }
        const float mean = meanRstd[2 * r], rstd = meanRstd[2 * r + 1];
        float first = 0, second = 0;
        #pragma omp simd reduction(+ : first, second)
        for (int64_t i = 0; i < d; ++i)
        {
            const float normal = (load(in[i]) - mean) * rstd;
            const float scaled = grad[i] * scale[i];
            first += scaled;
            second += scaled * normal;
        }
        first /= float(d);
        second /= float(d);
        #pragma omp simd
        for (int64_t i = 0; i < d; ++i)
        {
            const float normal = (load(in[i]) - mean) * rstd;
            dscale[i] += grad[i] * normal;
            dshift[i] += grad[i];
            store(rstd * (grad[i] * scale[i] - first - normal * second), to[i]);
        }
    }
}

template<class T>
void narrowAll(int64_t count, const float* values, T* to)
{
    #pragma omp simd
    for (int64_t i = 0; i < count; ++i) store(values[i], to[i]);
}

// Widths in use get loops of fixed length.
#define M4GN_BY_WIDTH(function)                                                                               \
    [](auto count, int64_t width, auto... rest)                                                               \
    {                                                                                                         \
        switch (width)                                                                                        \
        {                                                                                                     \
            case 64: return function<T, 64>(count, width, rest...);                                           \
            case 128: return function<T, 128>(count, width, rest...);                                         \
            default: return function<T, 0>(count, width, rest...);                                            \
        }                                                                                                     \
    }

template<class T>
constexpr Kernels<T> kernels()
{
    return Kernels<T>{
        M4GN_BY_WIDTH(edgeInput),
        M4GN_BY_WIDTH(edgeInputBackward),
        M4GN_BY_WIDTH(normForward),
        M4GN_BY_WIDTH(normBackward),
        narrowAll<T>,
    };
}

} // namespace

extern const Table table;
const Table table{kernels<float>(), kernels<uint16_t>()};

} // namespace M4GN_ISA
} // namespace m4gn
