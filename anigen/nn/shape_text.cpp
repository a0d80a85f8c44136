#include "anigen/nn/shape_text.h"

namespace anigen::nn {

std::string shape_text(torch::IntArrayRef shape) {
  std::string text;
  for (const std::int64_t size : shape) text += (text.empty() ? "" : ", ") + std::to_string(size);
  return "[" + text + "]";
}

std::string shape_text(const Tensor& tensor) { return tensor.defined() ? shape_text(tensor.sizes()) : "nothing"; }

}  // namespace anigen::nn
