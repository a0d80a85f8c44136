#include "anigen/io/arrays/row_quantization.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::io {

namespace {

constexpr std::size_t kLeastQuantized = 1024;
constexpr float kLargestStep = 127.0F;

bool is_floating(const NdArray& array) { return array.dtype == Dtype::kF32 || array.dtype == Dtype::kF64; }

bool pays_to_quantize(const NdArray& array) {
  const bool floating = is_floating(array) || array.dtype == Dtype::kF16 || array.dtype == Dtype::kBF16;
  return floating && array.shape.size() >= 2 && array.count() >= kLeastQuantized;
}

// int8 array and its scales.
std::pair<NdArray, NdArray> quantized(const NdArray& array, const std::string& file, const std::string& name) {
  const std::vector<float> values = array.as<float>();
  const auto rows = static_cast<std::size_t>(array.shape.front());
  const std::size_t columns = values.size() / rows;
  NdArray steps;
  steps.dtype = Dtype::kI8;
  steps.shape = array.shape;
  steps.bytes.reserve(values.size());
  std::vector<float> scales;
  for (std::size_t row = 0; row < rows; ++row) {
    const float* first = values.data() + row * columns;
    float largest = 0.0F;
    for (std::size_t i = 0; i < columns; ++i) {
      if (!std::isfinite(first[i])) throw InputError(file, name, "holds " + std::to_string(first[i]));
      largest = std::max(largest, std::fabs(first[i]));
    }
    const float scale = largest / kLargestStep;  // s_i
    for (std::size_t i = 0; i < columns; ++i) {
      const float step =
          scale > 0.0F ? std::clamp(std::nearbyint(first[i] / scale), -kLargestStep, kLargestStep) : 0.0F;
      steps.bytes.push_back(static_cast<std::uint8_t>(static_cast<std::int8_t>(step)));  // q
    }
    scales.push_back(scale);
  }
  return {std::move(steps), NdArray::from<float>(scales, {array.shape.front()})};
}

}  // namespace

NdArray halved(const NdArray& array, const std::string& file, const std::string& name) {
  if (!is_floating(array)) return array;
  NdArray half;
  half.dtype = Dtype::kF16;
  half.shape = array.shape;
  for (const float value : array.as<float>()) {
    const std::uint16_t bits = float_to_half(value);
    if (!std::isfinite(half_to_float(bits)))
      throw InputError(file, name, "holds " + std::to_string(value) + ", which half precision does not");
    half.bytes.push_back(static_cast<std::uint8_t>(bits & 0xFF));
    half.bytes.push_back(static_cast<std::uint8_t>(bits >> 8));
  }
  return half;
}

NamedArrays quantize_rows(const NamedArrays& arrays, const std::string& file) {
  NamedArrays result;
  for (const auto& [name, array] : arrays) {
    if (!pays_to_quantize(array)) {
      result.emplace_back(name, halved(array, file, name));
      continue;
    }
    auto [steps, scales] = quantized(array, file, name);
    result.emplace_back(name, std::move(steps));
    result.emplace_back(name + kRowScaleSuffix, std::move(scales));
  }
  return result;
}

NdArray dequantized(const NdArray& steps, const NdArray& scales, const std::string& file, const std::string& name) {
  if (steps.shape.empty() || scales.dtype != Dtype::kF32 || scales.shape != std::vector<std::int64_t>{steps.shape[0]})
    throw InputError(file, name + kRowScaleSuffix, "expected one float32 for each row of " + name);
  const std::vector<float> of_rows = scales.as<float>();
  std::vector<float> values;
  values.reserve(steps.bytes.size());
  const std::size_t columns = of_rows.empty() ? 0 : steps.bytes.size() / of_rows.size();
  for (std::size_t row = 0; row < of_rows.size(); ++row) {
    if (!std::isfinite(of_rows[row]) || of_rows[row] < 0.0F)
      throw InputError(file, name + kRowScaleSuffix,
                       "row " + std::to_string(row) + " has " + std::to_string(of_rows[row]));
    for (std::size_t i = row * columns; i < (row + 1) * columns; ++i)
      values.push_back(of_rows[row] * static_cast<float>(static_cast<std::int8_t>(steps.bytes[i])));
  }
  return NdArray::from<float>(values, steps.shape);
}

}  // namespace anigen::io
