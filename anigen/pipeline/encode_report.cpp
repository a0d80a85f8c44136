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
  Json json = to_json(static_cast<const EncodedLatents&>(result));
  if (result.reconstruction) {
    json["reconstruction"] = {{"shape", agreement_json(result.reconstruction->shape)},
                              {"skeleton", agreement_json(result.reconstruction->skeleton)}};
  }
  return json;
}

std::string to_text(const EncodeResult& result) {
  std::string text = to_text(static_cast<const EncodedLatents&>(result), "ss_latents");
  if (result.reconstruction) {
    text += agreement_line("shape", result.reconstruction->shape);
    text += agreement_line("skeleton", result.reconstruction->skeleton);
  }
  return text;
}

}  // namespace anigen::pipeline
