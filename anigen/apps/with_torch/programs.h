#pragma once
#include "anigen/apps/common/torch_half.h"

namespace anigen {

// The functions of TorchHalf, one source per program.
void run_encode(const EncodeArguments& arguments, const CommonOptions& common);
void run_generate(const GenerateArguments& arguments, const CommonOptions& common);
int run_train(const TrainArguments& arguments, const CommonOptions& common);
void retrieve(const RigArguments& arguments, const CommonOptions& common);
rigging::LearnedSteps learned_steps(const RigArguments& arguments, const CommonOptions& common);
void add_perceptual_metric(const EvalArguments& arguments, const CommonOptions& common,
                           eval::EvaluationRequest& request);
eval::SkinMethod skin_reconstruction(const std::string& run, const CommonOptions& common, Json& settings);
void evaluate_structures(const EvalArguments& arguments, const CommonOptions& common);

}  // namespace anigen
