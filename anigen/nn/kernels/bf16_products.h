#pragma once
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"

/// Products of bf16 matrices with fp32 sums, on CPUs where has_bf16_products(): by the tiles of Intel's AMX, sixteen
/// rows by sixteen columns at a time, where has_amx_products(), else by AVX512-BF16. One thread, no allocation.

namespace anigen::nn::kernels {

/// True if this CPU multiplies tiles of bf16 numbers, and ANIGEN_KERNELS asks for nothing narrower.
inline bool has_amx_products() { return kernel_form() >= KernelForm::kAmx; }

/// Factors and sums of a product; rows of each lie at a constant distance.
struct Bf16Product {
  const std::uint16_t* factors;  ///< [rows, 2 · pairs] bf16 numbers as their 16 bits
  std::int64_t factor_stride;    ///< numbers from one row of factors to the next
  const std::uint16_t* b;        ///< [pairs, 16 · vectors, 2]
  float* sums;                   ///< [rows, 16 · vectors]
  std::int64_t sum_stride;
  std::int64_t rows, pairs;
  std::int64_t vectors;  ///< 1 to 4
};

/// Multiplies on one thread. While it lives, nothing else that uses tiles, such as a product of oneDNN, may run on that
/// thread: tiles are set up once for products of as many rows and pairs.
class Bf16Multiplier {
 public:
  Bf16Multiplier() = default;
  ~Bf16Multiplier();
  Bf16Multiplier(const Bf16Multiplier&) = delete;
  Bf16Multiplier& operator=(const Bf16Multiplier&) = delete;

  /// sums[r, c] = Σ_p factors[r, 2p] b[p, c, 0] + factors[r, 2p + 1] b[p, c, 1], added to the sums that are there where
  /// `adds`. The order of the sums, and so their last bits, depend on the form of the kernels and on whether there are
  /// fewer than eight rows. @param ahead asked at least once per six rows and eight pairs, evenly over the product
  void multiply(const Bf16Product& product, bool adds, products::RowsAhead& ahead);
  void multiply(const Bf16Product& product, bool adds);

 private:
  void multiply_tiles(const Bf16Product& product, bool adds, products::RowsAhead& ahead);
  void multiply_tiles_of(Bf16Product product, bool adds, std::int64_t pairs, products::RowsAhead& ahead);

  std::int64_t rows_ = 0, pairs_ = 0;  // that tiles are set up for; 0: none
};

}  // namespace anigen::nn::kernels
