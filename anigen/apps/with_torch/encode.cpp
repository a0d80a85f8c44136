#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/encode_arguments.h"
#include "anigen/apps/with_torch/programs.h"
#include "anigen/core/error.h"
#include "anigen/nn/computing.h"
#include "anigen/pipeline/encode_sparse_structure.h"

namespace anigen {
namespace {

void print(const Json& json, const std::string& text, const CommonOptions& common) {
  std::fputs(common.json ? (json.dump(2) + "\n").c_str() : text.c_str(), stdout);
}

void require_some(const pipeline::EncodedLatents& result) {
  if (!result.failed.empty() && result.failed.size() == result.assets) {
    throw Error("no asset could be encoded; the first: " + result.failed.begin()->second);
  }
}

void reconstruct(const pipeline::ReconstructRequest& request, bool allow_failures, const CommonOptions& common) {
  const std::vector<pipeline::ReconstructedAsset> made = pipeline::reconstruct_assets(request);
  print(pipeline::to_json(made), pipeline::to_text(made), common);
  std::size_t failed = 0;
  for (const pipeline::ReconstructedAsset& asset : made) failed += asset.failure.empty() ? 0 : 1;
  if (failed > 0 && (!allow_failures || failed == made.size()))
    throw Error(std::to_string(failed) + " of " + std::to_string(made.size()) + " assets gave no file");
}

}  // namespace

void run_encode(const EncodeArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  if (arguments.task == EncodeArguments::Task::kReconstruct)
    return reconstruct(arguments.rebuilt, arguments.allow_failures, common);
  if (arguments.task == EncodeArguments::Task::kStructure) {
    const pipeline::EncodeResult result = pipeline::encode_sparse_structure(arguments.encoded);
    print(to_json(result), to_text(result), common);
    return require_some(result);
  }
  const pipeline::EncodedLatents result = pipeline::encode_structured_latents(arguments.encoded);
  print(to_json(result), to_text(result, "latents"), common);
  require_some(result);
}

}  // namespace anigen
