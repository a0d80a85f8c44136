#include "anigen/nn/kernels/tiles.h"

#include <cstddef>
#include <utility>

namespace anigen::nn::products {

namespace {

// Registers of an instruction set, and how many rows of a tile's sums fit into them beside a row of `right` and a value
// of `left`. Tiles are as wide as the registers allow: a value of `left` is loaded once for all vectors of its row, and
// processors load no more than one wide vector per product.
struct Registers128 {
  typedef float Vector __attribute__((vector_size(16)));
  typedef float Unaligned __attribute__((vector_size(16), aligned(4), may_alias));
  static constexpr std::size_t kSums = 8, kWidest = 1;
};
struct Registers256 {
  typedef float Vector __attribute__((vector_size(32)));
  typedef float Unaligned __attribute__((vector_size(32), aligned(4), may_alias));
  static constexpr std::size_t kSums = 12, kWidest = 1;
};
struct Registers512 {
  typedef float Vector __attribute__((vector_size(64)));
  typedef float Unaligned __attribute__((vector_size(64), aligned(4), may_alias));
  static constexpr std::size_t kSums = 24, kWidest = 4;
};

// Steps of a tile between rows asked for: more requests at a time than a core has room for would hold it up.
constexpr std::int64_t kAskingSteps = 16;

struct Operands {
  const float *left, *right;
  float* out;
  std::int64_t left_row, left_step, right_row, out_row, depth;
  bool accumulate;
  RowsAhead* ahead;
};

ANIGEN_INLINE float* out_row(const Operands& at, std::size_t row) {
  return at.out + static_cast<std::int64_t>(row) * at.out_row;
}

// Some rows of a tile. The packs count the vectors of a row, and the sums: row by row, vector by vector. Every index is
// a constant, so that the sums are registers whatever the compiler unrolls; vectors are neither passed nor returned,
// since how that is done depends on the instruction set.
template <typename Registers, std::size_t... kVector, std::size_t... kSum>
ANIGEN_INLINE void product_tile(const Operands& at, std::index_sequence<kVector...>, std::index_sequence<kSum...>) {
  using Vector = typename Registers::Vector;
  using Unaligned = typename Registers::Unaligned;
  constexpr std::size_t kVectors = sizeof...(kVector), kSums = sizeof...(kSum);
  Vector sums[kSums];
  ((sums[kSum] = Vector{}), ...);
  const float *left = at.left, *right = at.right;
  for (std::int64_t begin = 0; begin < at.depth; begin += kAskingSteps) {
    at.ahead->ask();
    const std::int64_t end = std::min(begin + kAskingSteps, at.depth);
    for (std::int64_t k = begin; k < end; ++k) {
      Vector row[kVectors];
      ((row[kVector] = reinterpret_cast<const Unaligned*>(right)[kVector]), ...);
      ((sums[kSum] += left[static_cast<std::int64_t>(kSum / kVectors) * at.left_row] * row[kSum % kVectors]), ...);
      left += at.left_step;
      right += at.right_row;
    }
  }
  if (at.accumulate) ((sums[kSum] += reinterpret_cast<Unaligned*>(out_row(at, kSum / kVectors))[kSum % kVectors]), ...);
  ((reinterpret_cast<Unaligned*>(out_row(at, kSum / kVectors))[kSum % kVectors] = sums[kSum]), ...);
}

// As many rows at a time as there are registers for, then the rest in halves.
template <typename Registers, std::size_t kVectors, std::size_t kRows>
ANIGEN_INLINE void product_rows(Operands at, std::int64_t rows) {
  constexpr auto kStep = static_cast<std::int64_t>(kRows);
  for (; rows >= kStep; rows -= kStep) {
    product_tile<Registers>(at, std::make_index_sequence<kVectors>(), std::make_index_sequence<kRows * kVectors>());
    at.left += kStep * at.left_row;
    at.out += kStep * at.out_row;
  }
  if constexpr (kRows > 1) product_rows<Registers, kVectors, kRows / 2>(at, rows);
}

// Panels of kTimes · kLanes columns, as many as there are, then the rest in narrower ones.
template <typename Registers, std::size_t kTimes>
ANIGEN_INLINE void product_panels(Operands at, std::int64_t rows, std::int64_t columns) {
  constexpr std::size_t kVectors =
      kTimes * static_cast<std::size_t>(kLanes) * sizeof(float) / sizeof(typename Registers::Vector);
  constexpr auto kColumns = static_cast<std::int64_t>(kTimes) * kLanes;
  for (; columns >= kColumns; columns -= kColumns) {
    product_rows<Registers, kVectors, Registers::kSums / kVectors>(at, rows);
    at.right += kColumns;
    at.out += kColumns;
  }
  if constexpr (kTimes > 1) product_panels<Registers, kTimes / 2>(at, rows, columns);
}

template <typename Registers>
ANIGEN_INLINE void product(const ProductSize& size, const Factor& left, const Block& right, const Block& out,
                           bool accumulate, RowsAhead& ahead) {
  const Operands at{left.values,  right.values, out.values, left.row,   left.column,
                    right.stride, out.stride,   size.depth, accumulate, &ahead};
  product_panels<Registers, Registers::kWidest>(at, size.rows, padded(size.columns));
}

using Multiply = void (*)(const ProductSize&, const Factor&, const Block&, const Block&, bool, RowsAhead&);

void multiply_128(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate,
                  RowsAhead& ahead) {
  product<Registers128>(size, left, right, out, accumulate, ahead);
}

#if defined(__x86_64__) && defined(__GNUC__)
__attribute__((target("avx2,fma"))) void multiply_256(const ProductSize& size, const Factor& left, const Block& right,
                                                      const Block& out, bool accumulate, RowsAhead& ahead) {
  product<Registers256>(size, left, right, out, accumulate, ahead);
}

__attribute__((target("avx512f"))) void multiply_512(const ProductSize& size, const Factor& left, const Block& right,
                                                     const Block& out, bool accumulate, RowsAhead& ahead) {
  product<Registers512>(size, left, right, out, accumulate, ahead);
}

Multiply chosen_multiply() {
  const KernelForm form = kernel_form();
  if (form >= KernelForm::kAvx512) return multiply_512;
  return form >= KernelForm::kAvx2 ? multiply_256 : multiply_128;
}
#else
Multiply chosen_multiply() { return multiply_128; }
#endif

}  // namespace

void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate,
              RowsAhead& ahead) {
  chosen_multiply()(size, left, right, out, accumulate, ahead);
}

void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate) {
  RowsAhead nothing;
  multiply(size, left, right, out, accumulate, nothing);
}

std::int64_t asking_calls(const ProductSize& size) {
  // As product_panels with the widest registers: panels as wide as may be, then narrower ones of more rows.
  std::int64_t tiles = 0, panels = padded(size.columns) / kLanes;
  for (auto vectors = static_cast<std::int64_t>(Registers512::kWidest); vectors > 0; vectors /= 2) {
    const std::int64_t rows = static_cast<std::int64_t>(Registers512::kSums) / vectors;
    tiles += panels / vectors * (size.rows / rows);  // what is left of the rows is asked in beside these
    panels %= vectors;
  }
  return std::max<std::int64_t>(tiles, 1) * ((size.depth + kAskingSteps - 1) / kAskingSteps);
}

void transpose(std::int64_t rows, std::int64_t columns, const Block& in, const Block& out) {
  using Four = Registers128::Vector;
  using Unaligned = Registers128::Unaligned;
  for (std::int64_t r = 0; r < rows; r += 4) {
    for (std::int64_t c = 0; c < columns; c += 4) {
      const float* from = in.values + r * in.stride + c;
      const Four a = *reinterpret_cast<const Unaligned*>(from);
      const Four b = *reinterpret_cast<const Unaligned*>(from + in.stride);
      const Four d = *reinterpret_cast<const Unaligned*>(from + 2 * in.stride);
      const Four e = *reinterpret_cast<const Unaligned*>(from + 3 * in.stride);
      const Four ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5), de_low = __builtin_shufflevector(d, e, 0, 4, 1, 5);
      const Four ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
      const Four de_high = __builtin_shufflevector(d, e, 2, 6, 3, 7);
      const Four first = __builtin_shufflevector(ab_low, de_low, 0, 1, 4, 5);
      const Four second = __builtin_shufflevector(ab_low, de_low, 2, 3, 6, 7);
      const Four third = __builtin_shufflevector(ab_high, de_high, 0, 1, 4, 5);
      const Four fourth = __builtin_shufflevector(ab_high, de_high, 2, 3, 6, 7);
      float* to = out.values + c * out.stride + r;
      *reinterpret_cast<Unaligned*>(to) = first;
      *reinterpret_cast<Unaligned*>(to + out.stride) = second;
      *reinterpret_cast<Unaligned*>(to + 2 * out.stride) = third;
      *reinterpret_cast<Unaligned*>(to + 3 * out.stride) = fourth;
    }
  }
}

}  // namespace anigen::nn::products
