#include "anigen/models/structured_latent_skin_unet.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;

constexpr std::int64_t kUnetFactor = 2;

sparse::SubdivideBlock unet_block(std::int64_t channels) {
  sparse::SubdivideBlockOptions options;
  options.channels = options.out_channels = channels;
  options.subdivide = false;
  options.skip_convolution = true;
  return sparse::SubdivideBlock(options);
}

}  // namespace

SkinUnetImpl::SkinUnetImpl(std::int64_t channels, std::int64_t levels) {
  torch::nn::ModuleList encoder, fuse, decoder;
  for (std::int64_t level = 0; level < levels; ++level) {
    down_blocks_.push_back(unet_block(channels));
    encoder->push_back(down_blocks_.back());
    fuse_.emplace_back(2 * channels, channels);
    fuse->push_back(fuse_.back());
    up_blocks_.push_back(unet_block(channels));
    decoder->push_back(up_blocks_.back());
  }
  register_module("enc", encoder);
  middle_ = register_module("mid", unet_block(channels));
  register_module("fuse", fuse);
  register_module("dec", decoder);
}

SparseTensor SkinUnetImpl::forward(const SparseTensor& x) {
  std::vector<SparseTensor> skips;
  SparseTensor h = x.with(x.feats.to(middle_->dtype()));
  for (sparse::SubdivideBlock& block : down_blocks_) {
    skips.push_back(block->forward(h));
    h = sparse::downsample(skips.back(), kUnetFactor);
  }
  h = middle_->forward(h);
  for (std::size_t level = skips.size(); level-- > 0;) {
    const SparseTensor& skip = skips[level];
    const SparseTensor up = sparse::upsample(h, skip.support, kUnetFactor);
    h = up_blocks_[level]->forward(skip.with(fuse_[level]->forward(torch::cat({up.feats, skip.feats}, 1))));
  }
  return x.with(h.feats.to(nn::dtype_of(x.feats)));
}

}  // namespace anigen::models
