#pragma once
#include <cstdint>

namespace anigen::nn {

/// Mixed precision on a CPU: tensors, sums, norms and parameters stay fp32; factors of matrix products and convolutions
/// are rounded to bf16 where they are multiplied, which a CPU with AVX512-BF16 does at twice the rate. Products of two
/// bf16 numbers are exact in fp32, so a result is off by the rounding of its factors, 2^-9 each. Any CPU can emulate
/// them: factors are rounded beforehand and the products are fp32, which takes a little longer than fp32 alone.

/// Ways to compute products of fp32 tensors on a CPU.
enum class MixedForm {
  kNone,      ///< fp32
  kKernels,   ///< by kernels for AVX512-BF16; fp32 on a CPU that has none (has_bf16_products())
  kEmulated,  ///< factors rounded to bf16, products in fp32, on any CPU
};

/// True when factors of products of fp32 tensors are rounded: emulated, or asked of kernels that this CPU has.
bool mixed_products();

/// True when they are rounded beforehand and multiplied in fp32.
bool emulated_mixed_products();

/// Products are computed so from now on. Process-wide.
void set_mixed_products(MixedForm form);

/// This form of products while it lives.
class MixedProducts {
 public:
  explicit MixedProducts(MixedForm form);
  ~MixedProducts();
  MixedProducts(const MixedProducts&) = delete;
  MixedProducts& operator=(const MixedProducts&) = delete;

 private:
  MixedForm before_;
};

}  // namespace anigen::nn

/// Products of matrices of fp32 numbers whose factors are rounded to bf16 and whose sums are fp32.
/// One thread each; all but round_in_place() only where has_bf16_products() says so. Numbers rounded to bf16 are passed
/// as their 16 bits.

namespace anigen::nn::kernels {

/// The nearest bf16 numbers, ties to even, as fp32. For any CPU. NaN stays NaN.
void round_in_place(float* values, std::int64_t count);

/// The nearest bf16 numbers, ties to even.
void round_to_bf16(const float* values, std::int64_t count, std::uint16_t* rounded);

/// A factor of which element (k, c) is values[k · row + c · column].
struct StridedMatrix {
  const float* values;
  std::int64_t row, column;
};

/// Rounds a matrix [depth, columns] and packs it for multiply_mixed(). @param depth even @param columns a multiple of
/// 16 @param packed [depth · columns]
void pack_mixed(const StridedMatrix& matrix, std::int64_t depth, std::int64_t columns, std::uint16_t* packed);

/// out[i, :] += in[i, :] · packed for `rows` rows. @param in [rows, depth], rounded @param out [rows, columns]
void multiply_mixed(const std::uint16_t* in, const std::uint16_t* packed, std::int64_t rows, std::int64_t depth,
                    std::int64_t columns, float* out);

/// Rows of a matrix in an order of their own: row i lies at values + index[i] · stride, or at values + i · stride
/// without an index.
struct ListedRows {
  const float* values;
  std::int64_t stride;
  const std::int32_t* index;

  const float* row(std::int64_t i) const { return values + (index == nullptr ? i : index[i]) * stride; }
};

/// sums[r, c] += Σ_i in(i)[r] · out(i)[c], in the order of the rows, for r < in_channels and c < out_channels.
/// @param sums rows of `stride` numbers, at least out_channels and a multiple of 16; what is beyond out_channels gets 0
/// added
void correlate_mixed(const ListedRows& in, const ListedRows& out, std::int64_t count, std::int64_t in_channels,
                     std::int64_t out_channels, float* sums, std::int64_t stride);

}  // namespace anigen::nn::kernels
