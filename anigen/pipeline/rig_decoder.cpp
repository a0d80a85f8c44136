#include "anigen/pipeline/rig_decoder.h"

#include <vector>

#include "anigen/pipeline/decoded_asset.h"

namespace anigen::pipeline {

RigDecoder::RigDecoder(const models::RunModel& found, torch::Device device, const geometry::MeanShiftOptions& grouping)
    : variant_(models::variant_of_run(found)), decoder_(models::load_rig_decoder(found, device, grouping)) {}

RigDecoder::Decoded RigDecoder::decode(const models::PerStream<sparse::SparseTensor>& latents,
                                       const fields::SkeletonTensors* given, const std::string& name) {
  const torch::NoGradGuard no_grad;
  std::vector<fields::SkeletonTensors> skeletons;
  if (given != nullptr) skeletons.push_back(*given);
  const auto decoded = decoder_->forward(latents, skeletons);
  const fields::ExtractedMesh mesh = decoder_->extract_meshes(decoded, /*training=*/false).front();
  const fields::SkeletonTensors& skeleton = decoded.joints.front();
  const SkinWeightRows weights = [&](std::int64_t begin, std::int64_t end) {
    return decoder_->skin_weights(mesh.skin_features.slice(0, begin, end), skeleton,
                                  decoded.joint_features.front().features);
  };
  DecodedAssetOptions options;
  options.name = name;
  return {decoded_asset(mesh, skeleton, weights, options),
          models::for_grouping(decoded.skeletons.front(), variant_.confidence)};
}

}  // namespace anigen::pipeline
