#include "anigen/io/arrays/row_quantization.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

constexpr std::int64_t kRows = 3, kColumns = 500;

// Rows of very different size, one of zeros.
std::vector<float> row_values() {
  std::vector<float> values;
  for (std::int64_t row = 0; row < kRows; ++row) {
    for (std::int64_t i = 0; i < kColumns; ++i)
      values.push_back(row == 1 ? 0.0F : std::sin(0.37F * static_cast<float>(i)) * (row == 0 ? 1e-3F : 40.0F));
  }
  return values;
}

// By way of a file of weights.
NamedArrays unpacked(const NamedArrays& packed) {
  const test::TemporaryFolder folder;
  write_safetensors(folder / "weights.safetensors", packed);
  return read_state_dict(folder / "weights.safetensors");
}

TEST(RowQuantization, ComesBackWithinHalfAStepOfEveryRow) {
  const std::vector<float> values = row_values(), bias{1.5F, -0.25F, 3.0F};
  const NamedArrays packed =
      quantize_rows({{"weight", NdArray::from(values, {kRows, 20, 25})}, {"bias", NdArray::from(bias, {3})}}, "file");
  ASSERT_EQ(packed.size(), 3u);
  EXPECT_EQ(packed[0].second.dtype, Dtype::kI8);
  EXPECT_EQ(packed[0].second.bytes.size(), values.size());
  EXPECT_EQ(find(packed, "bias")->dtype, Dtype::kF16) << "too small to pay";
  const NamedArrays back = unpacked(packed);
  ASSERT_EQ(back.size(), 2u);
  const NdArray& weight = *find(back, "weight");
  EXPECT_EQ(weight.shape, (std::vector<std::int64_t>{kRows, 20, 25}));
  const std::vector<float> got = weight.as<float>();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float largest = i < kColumns ? 1e-3F : 40.0F;
    EXPECT_NEAR(got[i], values[i], 0.5001F * largest / 127.0F) << i;
  }
  EXPECT_EQ(got[kColumns + 7], 0.0F) << "a row of zeros stays one";
}

TEST(RowQuantization, PacksHalvesThatWereExportedBefore) {
  const NdArray half = halved(NdArray::from(row_values(), {kRows, kColumns}), "file", "weight");
  const NamedArrays packed = quantize_rows({{"weight", half}}, "file");
  EXPECT_EQ(packed[0].second.dtype, Dtype::kI8);
  EXPECT_NEAR(unpacked(packed)[0].second.as<float>()[3], row_values()[3], 0.6F * 1e-3F / 127.0F);
}

TEST(RowQuantization, LeavesIntegersAndInt8WithoutScalesAlone) {
  NdArray steps;
  steps.dtype = Dtype::kI8;
  steps.shape = {2, 2};
  steps.bytes = {1, 2, 3, 255};
  const NamedArrays arrays{{"steps", steps},
                           {"rows", NdArray::from(std::vector<std::int64_t>(2000, 70000), {1000, 2})}};
  const NamedArrays back = unpacked(quantize_rows(arrays, "file"));
  EXPECT_EQ(find(back, "steps")->bytes, steps.bytes);
  EXPECT_EQ(find(back, "rows")->as<std::int64_t>()[0], 70000);
}

TEST(RowQuantization, RefusesWhatIsNotFiniteAndScalesThatDoNotFit) {
  std::vector<float> values = row_values();
  values[700] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(quantize_rows({{"weight", NdArray::from(values, {kRows, kColumns})}}, "file"), InputError);
  NamedArrays packed = quantize_rows({{"weight", NdArray::from(row_values(), {kRows, kColumns})}}, "file");
  for (const std::vector<float>& scales : {std::vector<float>{1.0F, 1.0F}, std::vector<float>{1.0F, -1.0F, 1.0F},
                                           std::vector<float>{1.0F, std::numeric_limits<float>::infinity(), 1.0F}}) {
    packed[1].second = NdArray::from(scales, {static_cast<std::int64_t>(scales.size())});
    EXPECT_THROW(unpacked(packed), InputError);
  }
  packed[1].second = NdArray::from(std::vector<std::int64_t>{1, 1, 1}, {3});
  EXPECT_THROW(unpacked(packed), InputError);
}

}  // namespace
}  // namespace anigen::io
