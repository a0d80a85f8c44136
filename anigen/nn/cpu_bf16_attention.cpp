#include "anigen/nn/cpu_bf16_attention.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/nn/bf16_attention_kernels.h"
#include "anigen/nn/bf16_bits.h"
#include "anigen/nn/bf16_tile.h"

namespace anigen::nn {
namespace {

using kernels::kBf16QueryBlock;

// The rows of a head as bits. @param heads_at which axis of the tensor counts heads
struct Bf16HeadRows {
  Bf16HeadRows(const Tensor& x, std::int64_t index, std::int64_t heads, int heads_at)
      : data(bf16_bits(x) + index / heads * x.stride(0) + index % heads * x.stride(heads_at)),
        stride(x.stride(3 - heads_at)) {}
  std::uint16_t* data;
  std::int64_t stride;
};

}  // namespace

bool prefers_bf16_attention(const Tensor& q) {
  return q.is_cpu() && dtype_of(q) == torch::kBFloat16 && kernels::bf16_attention_takes(q.size(-1)) &&
         kernels::has_bf16_products();
}

Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums) {
  const std::int64_t batch = q.size(0), heads = q.size(1), queries = q.size(2), keys = k.size(2), channels = q.size(3);
  const std::int64_t size = kernels::packed_bf16_size(keys, channels), all = batch * heads;
  const Tensor packed = torch::empty({2, all, size}, torch::kInt16);
  auto* const packed_keys = reinterpret_cast<std::uint16_t*>(packed.data_ptr<std::int16_t>());
  std::uint16_t* const packed_values = packed_keys + all * size;
  at::parallel_for(0, all, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t head = begin; head < end; ++head) {
      const Bf16HeadRows from_k(k, head, heads, 1), from_v(v, head, heads, 1);
      kernels::pack_bf16_keys(from_k.data, from_k.stride, keys, channels, packed_keys + head * size);
      kernels::pack_bf16_values(from_v.data, from_v.stride, keys, channels, packed_values + head * size);
    }
  });
  const Tensor out = torch::empty({batch, queries, heads, channels}, q.options());
  float* const sums = log_sums.data_ptr<float>();
  const auto scale = static_cast<float>(1.0 / std::sqrt(static_cast<double>(channels)));
  const std::int64_t blocks = (queries + kBf16QueryBlock - 1) / kBf16QueryBlock;
  at::parallel_for(0, all * blocks, 1, [&](std::int64_t begin, std::int64_t end) {
    std::vector<float> scratch(static_cast<std::size_t>(kernels::bf16_scratch_floats(channels)));
    products::RowsAhead nothing;
    for (std::int64_t item = begin; item < end; ++item) {
      const std::int64_t head = item / blocks, first = item % blocks * kBf16QueryBlock;
      const Bf16HeadRows from(q, head, heads, 1), to(out, head, heads, 2);
      kernels::attend_bf16({packed_keys + head * size, packed_values + head * size, keys, channels, scale},
                           from.data + first * from.stride, from.stride, std::min(kBf16QueryBlock, queries - first),
                           to.data + first * to.stride, to.stride, sums + head * queries + first, scratch.data(),
                           nothing);
    }
  });
  return out;
}

}  // namespace anigen::nn
