#pragma once
#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::test {

/// The part of a tensor that the description of an output names in brackets, such as "logits[:,:,1::4,0:8:2,3:]": one
/// slice start:stop:step per axis, each number optional. A negative stop counts from the end.
/// @throws std::runtime_error without such brackets, for another form of slice, or for another number of axes
inline torch::Tensor described_part(const torch::Tensor& volume, const std::string& description) {
  static const std::regex kBrackets(R"(\[([0-9:,\s-]*:[0-9:,\s-]*)\])"), kComma(R"(\s*,\s*)");
  static const std::regex kSlice(R"(\s*(\d*):(-?\d*)(?::(\d*))?\s*)");
  std::smatch brackets;
  if (!std::regex_search(description, brackets, kBrackets))
    throw std::runtime_error("no slices in '" + description + "'");
  const std::string inside = brackets[1];
  const std::vector<std::string> slices(std::sregex_token_iterator(inside.begin(), inside.end(), kComma, -1),
                                        std::sregex_token_iterator());
  if (static_cast<std::int64_t>(slices.size()) != volume.dim()) {
    throw std::runtime_error("'" + description + "' has " + std::to_string(slices.size()) + " slices, the tensor has " +
                             std::to_string(volume.dim()) + " axes");
  }
  torch::Tensor part = volume;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    std::smatch slice;
    if (!std::regex_match(slices[i], slice, kSlice))
      throw std::runtime_error("'" + slices[i] + "' in '" + description + "' is no slice");
    const auto axis = static_cast<std::int64_t>(i);
    const std::int64_t start = slice[1].length() > 0 ? std::stoll(slice[1].str()) : 0;
    const std::int64_t stop = slice[2].length() > 0 ? std::stoll(slice[2].str()) : part.size(axis);
    const std::int64_t step = slice[3].length() > 0 ? std::stoll(slice[3].str()) : 1;
    part = part.slice(axis, start, stop, step);
  }
  return part;
}

}  // namespace anigen::test
