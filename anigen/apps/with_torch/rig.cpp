#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/rig_arguments.h"
#include "anigen/apps/with_torch/programs.h"
#include "anigen/core/error.h"
#include "anigen/nn/computing.h"
#include "anigen/pipeline/anymate_rigger.h"
#include "anigen/pipeline/device.h"
#include "anigen/pipeline/retrieve_assets.h"
#include "anigen/pipeline/rignet_rigger.h"

namespace anigen {

rig::LearnedSteps learned_steps(const RigArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  const pipeline::LearnedModelFiles files{arguments.joint_model, arguments.connectivity_model, arguments.skin_model};
  const torch::Device device = pipeline::parse_device(common.device);
  const std::size_t influences = arguments.request.binding.heat.most_influences;
  if (arguments.method == kAnymate) {
    pipeline::AnymateRiggerOptions rigger;
    rigger.points = arguments.points;
    rigger.eps = arguments.eps;
    rigger.seed = common.seed;
    rigger.most_influences = influences;
    rigger.device = device;
    return pipeline::anymate_steps(pipeline::load_anymate_models(files, device), rigger);
  }
  pipeline::RignetRiggerOptions rigger;
  rigger.seed = common.seed;
  rigger.most_influences = influences;
  rigger.device = device;
  return pipeline::rignet_steps(pipeline::load_rignet_models(files, device), rigger);
}

void retrieve(const RigArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  pipeline::RetrievalRequest request;
  request.dataset = arguments.request.joints.collection;
  request.splits = arguments.request.joints.splits;
  request.views = arguments.views;
  request.pictures.background = pipeline::parse_background(arguments.background);
  request.seen =
      arguments.condition == "normal" ? loaders::ConditionPictures::kNormals : loaders::ConditionPictures::kColor;
  request.output = arguments.request.out;
  const auto pictures =
      arguments.image.empty()
          ? pipeline::pictures_of_dataset(request.dataset, {arguments.pictured.begin(), arguments.pictured.end()},
                                          arguments.most)
          : pipeline::pictures_at(arguments.image);
  const auto reports = pipeline::retrieve_assets(request, pictures);
  std::fputs(common.json ? (to_json(reports).dump(2) + "\n").c_str() : to_text(reports).c_str(), stdout);
  for (const auto& report : reports) {
    if (report.failure.empty()) return;
  }
  throw Error("none of the pictures could be rigged");
}

}  // namespace anigen
