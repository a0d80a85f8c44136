#include <cstdio>

#include "anigen/pipeline/encode_sparse_structure.h"

// How the result of an encoding is printed; what it does is in encode_sparse_structure.cpp.
namespace anigen::pipeline {
namespace {

Json agreement_json(const models::VoxelAgreement& agreement) {
  return {
      {"iou", agreement.iou}, {"precision", agreement.precision}, {"recall", agreement.recall}, {"f1", agreement.f1}};
}

std::string agreement_line(const char* name, const models::VoxelAgreement& agreement) {
  char line[160];
  std::snprintf(line, sizeof line, "%-9s IoU %.4f, F1 %.4f (precision %.4f, recall %.4f within 1 voxel)\n", name,
                agreement.iou, agreement.f1, agreement.precision, agreement.recall);
  return line;
}

}  // namespace

Json to_json(const EncodeResult& result) {
  Json failed = Json::object();
  for (const auto& [id, problem] : result.failed) failed[id] = problem;
  Json json = {{"name", result.name},
               {"checkpoint", result.checkpoint.string()},
               {"assets", result.assets},
               {"encoded", result.encoded},
               {"up_to_date", result.up_to_date},
               {"failed", failed},
               {"feats", to_json(result.shape)},
               {"feats_skl", to_json(result.skeleton)}};
  if (result.reconstruction) {
    json["reconstruction"] = {{"shape", agreement_json(result.reconstruction->shape)},
                              {"skeleton", agreement_json(result.reconstruction->skeleton)}};
  }
  return json;
}

std::string to_text(const EncodeResult& result) {
  std::string text = "ss_latents/" + result.name + ": " + std::to_string(result.encoded) + " encoded, " +
                     std::to_string(result.up_to_date) + " up to date, " + std::to_string(result.failed.size()) +
                     " failed, by " + result.checkpoint.string() + "\n";
  if (result.reconstruction) {
    text += agreement_line("shape", result.reconstruction->shape);
    text += agreement_line("skeleton", result.reconstruction->skeleton);
  }
  return text;
}

}  // namespace anigen::pipeline
