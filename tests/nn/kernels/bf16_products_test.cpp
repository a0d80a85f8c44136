#include "anigen/nn/kernels/bf16_products.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tests/support/kernel_forms.h"

namespace anigen::nn::kernels {
namespace {

struct Bf16Sizes {
  std::int64_t rows, pairs, vectors;
};

std::string bf16_words(const Bf16Sizes& sizes) {
  return std::to_string(sizes.rows) + " rows, " + std::to_string(sizes.pairs) + " pairs, " +
         std::to_string(sizes.vectors) + " vectors";
}

float widened(std::uint16_t bits) { return bits_as<float>(static_cast<std::uint32_t>(bits) << 16U); }

std::uint16_t rounded(float x) { return static_cast<std::uint16_t>(bits_as<std::uint32_t>(x) >> 16U); }

std::vector<std::uint16_t> random_numbers(std::size_t count, std::mt19937& random) {
  std::normal_distribution<float> normal;
  std::vector<std::uint16_t> numbers(count);
  for (std::uint16_t& number : numbers) number = rounded(normal(random));
  return numbers;
}

// Σ_k factors[r, k] b[k, c] in fp64, and Σ |factors[r, k] b[k, c]|.
struct Exact {
  double sum, magnitude;
};

Exact exact(const Bf16Product& product, std::int64_t r, std::int64_t c) {
  Exact result{0.0, 0.0};
  for (std::int64_t k = 0; k < 2 * product.pairs; ++k) {
    const double term = static_cast<double>(widened(product.factors[r * product.factor_stride + k])) *
                        static_cast<double>(widened(product.b[(k / 2 * product.vectors * kBf16Lanes + c) * 2 + k % 2]));
    result.sum += term;
    result.magnitude += std::abs(term);
  }
  return result;
}

// Products of these sizes in the form in use, with gaps between rows that must stay as they are.
void expect_exact(const Bf16Sizes& sizes, bool adds) {
  SCOPED_TRACE(bf16_words(sizes) + (adds ? ", added" : ""));
  constexpr float kUntouched = 12345.0F, kStart = 3.0F;
  std::mt19937 random(7);
  const std::int64_t columns = sizes.vectors * kBf16Lanes, factor_stride = 2 * sizes.pairs + 6, stride = columns + 5;
  const auto factors = random_numbers(static_cast<std::size_t>(sizes.rows * factor_stride), random);
  const auto b = random_numbers(static_cast<std::size_t>(2 * sizes.pairs * columns), random);
  std::vector<float> sums(static_cast<std::size_t>(sizes.rows * stride), kUntouched);
  for (std::int64_t r = 0; r < sizes.rows && adds; ++r) std::fill_n(sums.begin() + r * stride, columns, kStart);
  const Bf16Product product{factors.data(), factor_stride, b.data(),    sums.data(),
                            stride,         sizes.rows,    sizes.pairs, sizes.vectors};
  Bf16Multiplier().multiply(product, adds);
  for (std::int64_t r = 0; r < sizes.rows; ++r) {
    for (std::int64_t c = 0; c < stride; ++c) {
      const float got = sums[static_cast<std::size_t>(r * stride + c)];
      if (c >= columns) {
        ASSERT_EQ(got, kUntouched) << r << ", " << c;
        continue;
      }
      const Exact expected = exact(product, r, c);
      const double start = adds ? kStart : 0.0;
      // Rounding of fp32 sums: at most one unit of 2^-24 of the magnitude per term; far fewer happen.
      ASSERT_NEAR(got, start + expected.sum, 1e-6 * (start + expected.magnitude)) << r << ", " << c;
    }
  }
}

KERNEL_TEST(Bf16Products, AreThoseOfTheFormula) {
  if (!has_bf16_products()) return;
  for (const std::int64_t rows : {1, 6, 8, 15, 16, 17, 31, 32, 33, 70, 96}) {
    for (const std::int64_t pairs : {1, 8, 15, 16, 17, 24, 32, 128}) {
      for (const std::int64_t vectors : {1, 2, 3, 4}) {
        expect_exact({rows, pairs, vectors}, false);
        expect_exact({rows, pairs, vectors}, true);
        if (::testing::Test::HasFatalFailure()) return;
      }
    }
  }
}

KERNEL_TEST(Bf16Products, KeepNotANumberAndInfinity) {
  if (!has_bf16_products()) return;
  constexpr std::int64_t kRows = 40, kPairs = 20, kColumns = 16;
  std::vector<std::uint16_t> factors(kRows * 2 * kPairs, rounded(1.0F)), b(2 * kPairs * kColumns, rounded(1.0F));
  factors[3 * 2 * kPairs + 5] = rounded(std::nanf(""));
  factors[20 * 2 * kPairs + 39] = rounded(std::numeric_limits<float>::infinity());
  std::vector<float> sums(kRows * kColumns);
  Bf16Multiplier().multiply({factors.data(), 2 * kPairs, b.data(), sums.data(), kColumns, kRows, kPairs, 1}, false);
  for (std::int64_t r = 0; r < kRows; ++r) {
    const float sum = sums[static_cast<std::size_t>(r * kColumns + 2)];
    if (r == 3) {
      EXPECT_TRUE(std::isnan(sum));
    } else if (r == 20) {
      EXPECT_TRUE(std::isinf(sum));
    } else {
      EXPECT_EQ(sum, 2.0F * kPairs) << r;
    }
  }
}

}  // namespace
}  // namespace anigen::nn::kernels
