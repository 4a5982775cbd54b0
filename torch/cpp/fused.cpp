// Differentiable operations that join what libtorch would do in several passes over memory; for the CPU.
// The plain way of doing the same is in src/network.rs, and the two are tested against each other.

#include "kernels.hpp"

#include <ATen/ATen.h>
#include <torch/csrc/autograd/custom_function.h>

#include <cstring>
#include <optional>
#include <string>

using at::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::Function;
using torch::autograd::Variable;
using torch::autograd::variable_list;

namespace m4gn
{
namespace
{

const Table& best()
{
#ifdef M4GN_X86
    static const Table& chosen = []() -> const Table& {
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
            return v4::table;
        if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return v3::table;
        return base::table;
    }();
    return chosen;
#else
    return base::table;
#endif
}

template<class T> const Kernels<T>& kernels();
template<> const Kernels<float>& kernels<float>() { return best().single; }
template<> const Kernels<uint16_t>& kernels<uint16_t>() { return best().half; }

template<class T> const T* in(const Tensor& t) { return static_cast<const T*>(t.const_data_ptr()); }
template<class T> T* out(const Tensor& t) { return static_cast<T*>(t.data_ptr()); }

// Calls a generic lambda with a value of the tensor's type.
template<class F> void byKind(const Tensor& t, F&& f)
{
    if (t.scalar_type() == at::kBFloat16) f(uint16_t());
    else if (t.scalar_type() == at::kFloat) f(float());
    else TORCH_CHECK(false, "m4gn: expected float or bfloat16 rows, found ", t.scalar_type());
}

void checkRows(const Tensor& t, const char* name)
{
    TORCH_CHECK(t.device().is_cpu() && t.dim() == 2 && t.is_contiguous(), "m4gn: ", name, " must be contiguous rows on the CPU");
}

struct EdgeInput : Function<EdgeInput>
{
    static Tensor forward(AutogradContext* ctx, Tensor a, Tensor ends, Tensor senders, Tensor receivers)
    {
        checkRows(a, "edge rows");
        checkRows(ends, "node rows");
        TORCH_CHECK(
            ends.size(1) == 2 * a.size(1) && ends.scalar_type() == a.scalar_type() &&
                senders.numel() == a.size(0) && receivers.numel() == a.size(0),
            "m4gn: edge and node rows do not match");
        Tensor y = at::empty_like(a);
        byKind(a, [&](auto type) {
            using T = decltype(type);
            kernels<T>().edge_input(
                a.size(0), a.size(1), in<T>(a), in<T>(ends), in<int64_t>(senders), in<int64_t>(receivers),
                out<T>(y));
        });
        ctx->save_for_backward({y, senders, receivers});
        ctx->saved_data["nodes"] = ends.size(0);
        return y;
    }

    static variable_list backward(AutogradContext* ctx, variable_list grads)
    {
        const auto saved = ctx->get_saved_variables();
        const Tensor &y = saved[0], &senders = saved[1], &receivers = saved[2];
        const Tensor dy = grads[0].contiguous();
        Tensor dx = at::empty_like(y);
        Tensor sums = at::zeros({ctx->saved_data["nodes"].toInt(), 2 * y.size(1)}, y.options().dtype(at::kFloat));
        Tensor dends = y.scalar_type() == at::kFloat ? sums : at::empty_like(sums, y.options());
        byKind(y, [&](auto type) {
            using T = decltype(type);
            kernels<T>().edge_input_backward(
                y.size(0), y.size(1), in<T>(dy), in<T>(y), in<int64_t>(senders), in<int64_t>(receivers),
                out<T>(dx), out<float>(sums));
            if (!std::is_same<T, float>::value) kernels<T>().narrow(sums.numel(), in<float>(sums), out<T>(dends));
        });
        return {dx, dends, Variable(), Variable()};
    }
};

// Returns {out, out as x's kind, sums as x's kind}; the last two only where asked for and different.
struct Norm : Function<Norm>
{
    static variable_list forward(
        AutogradContext* ctx, std::optional<Tensor> residualOrNone, Tensor x, Tensor scale, Tensor shift,
        std::optional<Tensor> receiversOrNone, int64_t nodes)
    {
        const Tensor residual = residualOrNone.value_or(Tensor()), receivers = receiversOrNone.value_or(Tensor());
        checkRows(x, "rows");
        TORCH_CHECK(scale.is_contiguous() && shift.is_contiguous(), "m4gn: scales must be contiguous");
        const bool half = x.scalar_type() == at::kBFloat16, sum = receivers.defined(), add = residual.defined();
        if (add)
        {
            checkRows(residual, "residual rows");
            TORCH_CHECK(residual.sizes() == x.sizes() && residual.scalar_type() == at::kFloat, "m4gn: residual rows do not match");
        }
        const auto single = x.options().dtype(at::kFloat);
        Tensor result = at::empty(x.sizes(), single);
        Tensor copy = half ? at::empty_like(x) : Tensor();
        Tensor sums = sum ? at::zeros({nodes, x.size(1)}, single) : Tensor();
        Tensor narrow = sum && half ? at::empty(sums.sizes(), x.options()) : sums;
        Tensor moments = at::empty({x.size(0), 2}, single);
        byKind(x, [&](auto type) {
            using T = decltype(type);
            kernels<T>().norm(
                x.size(0), x.size(1), add ? in<float>(residual) : nullptr, in<T>(x), in<float>(scale),
                in<float>(shift), sum ? in<int64_t>(receivers) : nullptr, out<float>(result),
                half ? out<T>(copy) : nullptr, sum ? out<float>(sums) : nullptr, out<float>(moments));
            if (sum && half) kernels<T>().narrow(sums.numel(), in<float>(sums), out<T>(narrow));
        });
        ctx->save_for_backward({x, scale, moments, sum ? receivers : Tensor()});
        ctx->saved_data["add"] = add;
        ctx->set_materialize_grads(false);
        variable_list results{result};
        if (half) results.push_back(copy);
        if (sum) results.push_back(narrow);
        return results;
    }

    static variable_list backward(AutogradContext* ctx, variable_list grads)
    {
        const auto saved = ctx->get_saved_variables();
        const Tensor &x = saved[0], &scale = saved[1], &moments = saved[2], &receivers = saved[3];
        const bool half = x.scalar_type() == at::kBFloat16, sum = receivers.defined();
        const auto take = [](const Tensor& t) { return t.defined() ? t.contiguous() : t; };
        const Tensor dout = take(grads[0]);
        const Tensor dcopy = half ? take(grads[1]) : Tensor();
        const Tensor dsums = sum ? take(grads[half ? 2 : 1]) : Tensor();
        const auto single = x.options().dtype(at::kFloat);
        Tensor g = at::empty(x.sizes(), single), dx = at::empty_like(x);
        Tensor dscale = at::zeros_like(scale), dshift = at::zeros_like(scale);
        byKind(x, [&](auto type) {
            using T = decltype(type);
            kernels<T>().norm_backward(
                x.size(0), x.size(1), dout.defined() ? in<float>(dout) : nullptr,
                dcopy.defined() ? in<T>(dcopy) : nullptr, dsums.defined() ? in<T>(dsums) : nullptr,
                sum ? in<int64_t>(receivers) : nullptr, in<T>(x), in<float>(scale), in<float>(moments),
                out<float>(g), out<T>(dx), out<float>(dscale), out<float>(dshift));
        });
        return {ctx->saved_data["add"].toBool() ? g : Tensor(), dx, dscale, dshift, Variable(), Variable()};
    }
};

// The door: C++ exceptions become a message that the caller frees.
template<class F> char* guarded(F&& body)
{
    try
    {
        body();
        return nullptr;
    }
    catch (const std::exception& e)
    {
        return strdup(e.what());
    }
    catch (...)
    {
        return strdup("unknown C++ exception");
    }
}

} // namespace
} // namespace m4gn

extern "C"
{

char* m4gn_fused_edge_input(
    const Tensor* a, const Tensor* ends, const Tensor* senders, const Tensor* receivers, Tensor** result)
{
    return m4gn::guarded([&] {
        *result = new Tensor(m4gn::EdgeInput::apply(*a, *ends, *senders, *receivers));
    });
}

// residual and receivers may be null; results holds three pointers, of which as many are set as there are results.
char* m4gn_fused_norm(
    const Tensor* residual, const Tensor* x, const Tensor* scale, const Tensor* shift, const Tensor* receivers,
    int64_t nodes, Tensor** results)
{
    return m4gn::guarded([&] {
        const auto all = m4gn::Norm::apply(
            residual ? std::make_optional(*residual) : std::nullopt, *x, *scale, *shift,
            receivers ? std::make_optional(*receivers) : std::nullopt, nodes);
        for (size_t i = 0; i < all.size(); ++i) results[i] = new Tensor(all[i]);
    });
}

} // extern "C"
