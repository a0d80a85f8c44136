#include "anigen/train/structured_latent_memory.h"

namespace anigen::train {
namespace {

constexpr double kBytes = 4.0;         // fp32
constexpr double kRowsPerBlock = 8.0;  // two norms, q, k, v, the attention's result, two residual sums
constexpr double kHiddenRows = 2.0;    // before and after the activation
constexpr double kChildren = 8.0;

double torso_rows(const models::StructuredLatentCoderOptions& coder, std::int64_t channels, std::int64_t voxels) {
  const double per_block = kRowsPerBlock + kHiddenRows * coder.mlp_ratio;
  return static_cast<double>(coder.num_blocks * channels * voxels) * per_block;
}

double torsos(const models::StructuredLatentCoderOptions& coder, std::int64_t voxels, std::int64_t skeleton_voxels) {
  return torso_rows(coder, coder.model_channels, voxels) + torso_rows(coder, coder.model_channels_skin, voxels) +
         torso_rows(coder, coder.model_channels_skl, skeleton_voxels);
}

// Per fine voxel: the input twice, both convolutions, norm and activation between, skip and sum.
double subdivide(double fine_voxels, double in, double out) { return fine_voxels * (2.0 * in + 6.0 * out); }

}  // namespace

std::int64_t activation_bytes(const models::StructuredLatentEncoderOptions& encoder,
                              const models::StructuredLatentDecoderOptions& decoder, std::int64_t voxels,
                              std::int64_t skeleton_voxels) {
  double numbers = torsos(encoder, voxels, skeleton_voxels) + torsos(decoder, voxels, skeleton_voxels);
  const auto width = static_cast<double>(decoder.model_channels);
  const double half = kChildren * static_cast<double>(voxels), whole = kChildren * half;
  for (const std::int64_t stream : {decoder.model_channels, decoder.model_channels_skin}) {
    numbers += subdivide(half, static_cast<double>(stream), width / 4.0) + subdivide(whole, width / 4.0, width / 8.0);
  }
  numbers += 2.0 * whole * static_cast<double>(decoder.mesh_options().channels());
  return static_cast<std::int64_t>(kBytes * numbers);
}

}  // namespace anigen::train
