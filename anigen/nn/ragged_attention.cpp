#include "anigen/nn/ragged_attention.h"

#include "anigen/nn/cpu_ragged_attention.h"
#include "anigen/nn/tensor_ragged_attention.h"

namespace anigen::nn {
namespace {

void check_offsets(const char* name, const Tensor& offsets, std::int64_t rows) {
  TORCH_CHECK(offsets.dim() == 1 && offsets.size(0) > 0 && offsets.is_cpu() && offsets.is_contiguous() &&
                  dtype_of(offsets) == torch::kInt64,
              "ragged attention: ", name, " offsets must be contiguous int64 on the CPU, found ", offsets.dtype(), " ",
              offsets.sizes(), " on ", offsets.device());
  const std::int64_t* values = offsets.data_ptr<std::int64_t>();
  const std::int64_t sequences = offsets.size(0) - 1;
  TORCH_CHECK(values[0] == 0 && values[sequences] == rows, "ragged attention: ", name, " offsets go from ", values[0],
              " to ", values[sequences], ", there are ", rows, " rows");
  for (std::int64_t s = 0; s < sequences; ++s) {
    TORCH_CHECK(values[s] <= values[s + 1], "ragged attention: ", name, " offsets descend from ", values[s], " to ",
                values[s + 1], " at sequence ", s);
  }
}

}  // namespace

Tensor ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                        const Tensor& k_offsets) {
  TORCH_CHECK(q.dim() == 3 && k.dim() == 3 && v.sizes() == k.sizes() && q.size(1) == k.size(1) &&
                  q.size(2) == k.size(2) && q.size(1) > 0 && q.size(2) > 0,
              "ragged attention of queries ", q.sizes(), " to keys ", k.sizes(), " and values ", v.sizes());
  TORCH_CHECK(dtype_of(q) == dtype_of(k) && dtype_of(q) == dtype_of(v) && q.is_floating_point(),
              "ragged attention of queries of type ", q.dtype(), " to keys of type ", k.dtype(), " and values of type ",
              v.dtype());
  check_offsets("query", q_offsets, q.size(0));
  check_offsets("key", k_offsets, k.size(0));
  TORCH_CHECK(q_offsets.size(0) == k_offsets.size(0), "ragged attention of ", q_offsets.size(0) - 1,
              " sequences of queries to ", k_offsets.size(0) - 1, " of keys");
  if (q.is_cpu() && dtype_of(q) != torch::kFloat64) return cpu_ragged_attention(q, k, v, q_offsets, k_offsets);
  return tensor_ragged_attention(q, k, v, q_offsets, k_offsets);
}

}  // namespace anigen::nn
