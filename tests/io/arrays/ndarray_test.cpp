#include "anigen/io/arrays/ndarray.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

TEST(Half, KnownValues) {
  EXPECT_EQ(half_to_float(0x3C00), 1.0f);
  EXPECT_EQ(half_to_float(0xC000), -2.0f);
  EXPECT_EQ(half_to_float(0x7BFF), 65504.0f);
  EXPECT_EQ(half_to_float(0x0001), std::ldexp(1.0f, -24));  // smallest subnormal
  EXPECT_EQ(half_to_float(0x0400), std::ldexp(1.0f, -14));  // smallest normal
  EXPECT_EQ(half_to_float(0x7C00), std::numeric_limits<float>::infinity());
  EXPECT_TRUE(std::isnan(half_to_float(0x7E01)));
  EXPECT_TRUE(std::signbit(half_to_float(0x8000)));
  EXPECT_EQ(bfloat16_to_float(0x3F80), 1.0f);
  EXPECT_EQ(bfloat16_to_float(0xC2F7), -123.5f);
}

TEST(Half, EveryValueSurvivesTheRoundTrip) {
  for (std::uint32_t bits = 0; bits < 0x10000; ++bits) {
    const auto half = static_cast<std::uint16_t>(bits);
    const float from_half = half_to_float(half), from_bfloat16 = bfloat16_to_float(half);
    if (std::isnan(from_half)) {
      EXPECT_TRUE(std::isnan(half_to_float(float_to_half(from_half))));
    } else {
      ASSERT_EQ(float_to_half(from_half), half);
    }
    if (std::isnan(from_bfloat16)) {
      EXPECT_TRUE(std::isnan(bfloat16_to_float(float_to_bfloat16(from_bfloat16))));
    } else {
      ASSERT_EQ(float_to_bfloat16(from_bfloat16), half);
    }
  }
}

TEST(Half, RoundsToNearestAndTiesToEven) {
  const float step = std::ldexp(1.0f, -10);  // between halves at 1
  EXPECT_EQ(float_to_half(1.0f + 0.5f * step), 0x3C00);
  EXPECT_EQ(float_to_half(1.0f + 1.5f * step), 0x3C02);
  EXPECT_EQ(float_to_half(1.0f + 0.51f * step), 0x3C01);
  EXPECT_EQ(float_to_half(65519.0f), 0x7BFF);
  EXPECT_EQ(float_to_half(65520.0f), 0x7C00);
  EXPECT_EQ(float_to_half(-1e30f), 0xFC00);
  const float smallest = std::ldexp(1.0f, -24);
  EXPECT_EQ(float_to_half(0.5f * smallest), 0x0000);
  EXPECT_EQ(float_to_half(0.51f * smallest), 0x0001);
  EXPECT_EQ(float_to_half(1.5f * smallest), 0x0002);
  EXPECT_EQ(float_to_half(std::ldexp(1.0f, -14) - 0.25f * smallest), 0x0400);  // carries into the normals
  EXPECT_EQ(float_to_half(1e-30f), 0x0000);
  const float bf_step = std::ldexp(1.0f, -7);
  EXPECT_EQ(float_to_bfloat16(1.0f + 0.5f * bf_step), 0x3F80);
  EXPECT_EQ(float_to_bfloat16(1.0f + 1.5f * bf_step), 0x3F82);
  EXPECT_EQ(float_to_bfloat16(std::numeric_limits<float>::max()), 0x7F80);
}

TEST(NdArray, RoundTripsAndConverts) {
  const NdArray ints = NdArray::from<std::int32_t>({1, -2, 3, 4, 5, 6}, {2, 3});
  EXPECT_EQ(ints.dtype, Dtype::kI32);
  EXPECT_EQ(ints.count(), 6u);
  EXPECT_EQ(ints.as<float>(), (std::vector<float>{1, -2, 3, 4, 5, 6}));
  EXPECT_EQ(ints.as<std::int64_t>(), (std::vector<std::int64_t>{1, -2, 3, 4, 5, 6}));
  const NdArray scalar = NdArray::from<double>({2.5}, {});
  EXPECT_EQ(scalar.count(), 1u);
  EXPECT_EQ(scalar.as<double>(), std::vector<double>{2.5});
  EXPECT_EQ(NdArray::from<float>({}, {0, 3}).count(), 0u);
  const NdArray halves{Dtype::kF16, {2}, {0x00, 0x3C, 0x00, 0xC0}};
  EXPECT_EQ(halves.as<float>(), (std::vector<float>{1, -2}));
  const NdArray flags{Dtype::kBool, {2}, {0, 1}};
  EXPECT_EQ(flags.as<std::int32_t>(), (std::vector<std::int32_t>{0, 1}));
}

TEST(NdArray, RefusesWhatDoesNotFit) {
  EXPECT_THROW(NdArray::from<std::int64_t>({std::int64_t{1} << 40}, {1}).as<std::int32_t>(), Error);
  EXPECT_THROW(NdArray::from<double>({0.5}, {1}).as<std::int32_t>(), Error);
  EXPECT_THROW(NdArray::from<double>({std::nan("")}, {1}).as<std::int64_t>(), Error);
  EXPECT_THROW(NdArray::from<double>({9.3e18}, {1}).as<std::int64_t>(), Error);
  EXPECT_EQ(NdArray::from<double>({-9223372036854775808.0}, {1}).as<std::int64_t>()[0],
            std::numeric_limits<std::int64_t>::min());
  EXPECT_THROW(NdArray::from<std::uint64_t>({~std::uint64_t{0}}, {1}).as<std::int64_t>(), Error);
  EXPECT_THROW(NdArray::from<std::int32_t>({-1}, {1}).as<std::uint8_t>(), Error);
  EXPECT_TRUE(std::isnan(NdArray::from<double>({std::nan("")}, {1}).as<float>()[0]));
  EXPECT_THROW(NdArray::from<float>({1, 2, 3}, {2}), Error);
  EXPECT_THROW((NdArray{Dtype::kF32, {std::int64_t{1} << 40, std::int64_t{1} << 40}, {}}.count()), Error);
  EXPECT_THROW((NdArray{Dtype::kF32, {-1}, {}}.count()), Error);
  EXPECT_THROW((NdArray{Dtype::kF32, {2}, {0, 0, 0, 0}}.as<float>()), Error);
}

TEST(NdArray, FindsByName) {
  NamedArrays arrays;
  arrays.emplace_back("a", NdArray::from<float>({1}, {1}));
  EXPECT_EQ(find(arrays, "a"), &arrays[0].second);
  EXPECT_EQ(find(arrays, "b"), nullptr);
}

}  // namespace
}  // namespace anigen::io
