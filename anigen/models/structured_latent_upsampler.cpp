#include "anigen/models/structured_latent_upsampler.h"

#include "anigen/models/structured_latent_torso.h"

namespace anigen::models {
namespace {

sparse::SubdivideBlock subdivide_block(std::int64_t channels, std::int64_t out_channels) {
  sparse::SubdivideBlockOptions options;
  options.channels = channels;
  options.out_channels = out_channels;
  return sparse::SubdivideBlock(options);
}

}  // namespace

StructuredLatentUpsampler::StructuredLatentUpsampler(torch::nn::Module& model, const char* name, std::int64_t channels,
                                                     std::int64_t between, std::int64_t behind) {
  blocks_ = {subdivide_block(channels, between), subdivide_block(between, behind)};
  torch::nn::ModuleList list;
  for (const sparse::SubdivideBlock& block : blocks_) list->push_back(block);
  model.register_module(name, list);
}

sparse::SparseTensor StructuredLatentUpsampler::forward(const sparse::SparseTensor& x, bool recompute) {
  sparse::SparseTensor h = x;
  for (sparse::SubdivideBlock& block : blocks_) {
    h = run_part(recompute, h.with(h.feats.to(block->dtype())),
                 [block](const sparse::SparseTensor& rows) mutable { return block->forward(rows); });
  }
  return h;
}

}  // namespace anigen::models
