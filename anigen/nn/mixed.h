#pragma once

namespace anigen::nn {

/// Mixed precision on a CPU: tensors, sums, norms and parameters stay fp32; factors of matrix products and convolutions
/// are rounded to bf16 where they are multiplied, which a CPU with AVX512-BF16 does at twice the rate. Products of two
/// bf16 numbers are exact in fp32, so a result is off by the rounding of its factors, 2^-9 each.

/// True when products of fp32 tensors are computed so: it was asked for, and this CPU can (has_bf16_products()).
bool mixed_products();

/// Products are computed so from now on, or no more. Process-wide. What was asked of a CPU that cannot stays fp32.
void set_mixed_products(bool mixed);

/// Mixed products, or none, while it lives.
class MixedProducts {
 public:
  explicit MixedProducts(bool mixed);
  ~MixedProducts();
  MixedProducts(const MixedProducts&) = delete;
  MixedProducts& operator=(const MixedProducts&) = delete;

 private:
  bool before_;
};

}  // namespace anigen::nn
