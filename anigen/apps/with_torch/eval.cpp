#include <cstdio>
#include <memory>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/eval_arguments.h"
#include "anigen/apps/with_torch/programs.h"
#include "anigen/core/error.h"
#include "anigen/eval/comparison/evaluate_command.h"
#include "anigen/eval/skin_command.h"
#include "anigen/nn/computing.h"
#include "anigen/pipeline/perceptual_metric.h"
#include "anigen/pipeline/skin_reconstruction.h"
#include "anigen/pipeline/structure_evaluation.h"

namespace anigen {

eval::SkinMethod skin_reconstruction(const std::string& run, const CommonOptions& common, Json& settings) {
  nn::set_up_computing(common.threads);
  const auto model = std::make_shared<pipeline::SkinReconstruction>(run, common.device);
  settings["checkpoint"] = model->checkpoint().string();
  settings["parameters"] = model->parameters();
  settings["features_per_vertex"] = model->features_per_vertex();
  eval::SkinMethod method;
  method.key = "skin_ae";
  method.label = "SkinAE reconstruction";
  method.parallel = false;
  method.predict = [model](const io::DatasetItem&, const eval::GroundTruth& truth) {
    return model->reconstruct(truth.joints, truth.parents, truth.skin);
  };
  return method;
}

void add_perceptual_metric(const EvalArguments& arguments, const CommonOptions& common,
                           eval::EvaluationRequest& request) {
  nn::set_up_computing(common.threads);
  const std::vector<std::filesystem::path> files(arguments.lpips_weights.begin(), arguments.lpips_weights.end());
  const auto metric = std::make_shared<pipeline::PerceptualMetric>(files, common.device);
  request.settings.lpips = metric->describe();
  request.perceptual = [metric](const io::Image& a, const io::Image& b) { return metric->distance(a, b); };
}

void evaluate_structures(const EvalArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  pipeline::StructureEvaluationRequest request;
  request.run = arguments.ss_flow;
  request.autoencoder = arguments.ss_dae;
  request.data = arguments.truth;
  request.split = arguments.splits.empty() ? "" : arguments.splits.front();
  request.train_split = arguments.train_split;
  request.out = arguments.out;
  request.strengths = arguments.strengths;
  request.steps = arguments.steps;
  request.most = arguments.most;
  request.pictured = arguments.pictured;
  request.retrieval_views = arguments.views;
  request.seed = common.seed;
  request.device = common.device;
  const pipeline::StructureEvaluation evaluation = pipeline::evaluate_structures(request);
  std::fputs((eval::to_markdown(evaluation.table()) + "\n").c_str(), stdout);
}

}  // namespace anigen
