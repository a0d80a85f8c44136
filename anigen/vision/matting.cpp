#include "anigen/vision/matting.h"

namespace anigen::vision {

MattingUNetOptions::MattingUNetOptions() {
  width = 128;
  num_blocks = 2;
  num_heads = 4;
}

void MattingUNetOptions::fields(ConfigFields& f) { UNetOptions::fields(f); }

void MattingUNetOptions::validate(const std::string& file, const std::string& pointer) const {
  UNetOptions::validate(file, pointer);
}

MattingUNetImpl::MattingUNetImpl(const MattingUNetOptions& options, nn::Init init) : options_(options) {
  options_.validate();
  const std::int64_t channels = options_.map_channels();
  constexpr std::int64_t kColors = 3;
  unet_ = register_module("unet", UNet(options_));
  coarse_ = register_module("coarse", convolution(channels, 1, 1));
  detail_ = register_module("detail", convolution(channels + kColors, channels, 3));
  fine_ = register_module("fine", convolution(channels, 1, 3));
  if (init == nn::Init::kPublished) nn::xavier_uniform_linears(*this);
}

Tensor MattingUNetImpl::forward(const Tensor& images) {
  const Tensor map = unet_->forward(images).map;
  const Tensor seen = torch::cat({doubled(map), 2.0 * images - 1.0}, 1);
  return doubled(coarse_->forward(map)) + fine_->forward(activated(detail_->forward(seen)));
}

}  // namespace anigen::vision
