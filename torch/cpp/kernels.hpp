// Loops over latent rows that libtorch has only as several passes over memory. Compiled once an instruction set
// (see build.rs); fused.cpp picks the widest that the processor has.
//
// Rows are `width` values of T: float, or bfloat16 held as its 16 bits. Sums are in float.
#pragma once

#include <cstdint>

namespace m4gn
{

// Kernels of one value type.
template<class T>
struct Kernels
{
    // y[e] = relu(a[e] + ends[sender[e]][0..width] + ends[receiver[e]][width..2 width])
    void (*edge_input)(
        int64_t edges, int64_t width, const T* a, const T* ends, const int64_t* senders,
        const int64_t* receivers, T* y);

    // dx = dy where y > 0; dends [nodes x 2 width] += dx at both ends
    void (*edge_input_backward)(
        int64_t edges, int64_t width, const T* dy, const T* y, const int64_t* senders,
        const int64_t* receivers, T* dx, float* dends);

    // out = residual + layerNorm(x) * scale + shift, copy = out as T, sums[receiver] += out.
    // residual, copy and receivers/sums may be null. mean_rstd: [rows x 2] for the backward pass.
    void (*norm)(
        int64_t rows, int64_t width, const float* residual, const T* x, const float* scale,
        const float* shift, const int64_t* receivers, float* out, T* copy, float* sums, float* mean_rstd);

    // g = dout + dcopy + dsums[receiver] (each may be null) -> g itself, dx, dscale, dshift (both added to)
    void (*norm_backward)(
        int64_t rows, int64_t width, const float* dout, const T* dcopy, const T* dsums,
        const int64_t* receivers, const T* x, const float* scale, const float* mean_rstd, float* g, T* dx,
        float* dscale, float* dshift);

    // values as T
    void (*narrow)(int64_t count, const float* values, T* to);
};

struct Table
{
    Kernels<float> single;
    Kernels<uint16_t> half;
};

namespace base { extern const Table table; }
#ifdef M4GN_X86
namespace v3 { extern const Table table; }
namespace v4 { extern const Table table; }
#endif

} // namespace m4gn
