// Full-size key listings: a model built from the published config must have the same keys, order, shapes, run-time
// dtypes, kinds and trainable flags.
#include <cstdio>

#include "anigen/models/skin_autoencoder.h"
#include "anigen/models/state_dict.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void compare(Fixture& fixture, const std::string& model_key, const torch::nn::Module& module,
             const std::vector<std::string>& half_precision_modules) {
  const Json& spec = fixture.json().at("models").at(model_key);
  const std::vector<models::StateEntry> entries = models::state_entries(module);
  const std::vector<torch::Dtype> dtypes = models::published_dtypes(module, half_precision_modules);
  const Json& wanted = spec.at("tensors");
  fixture.check_true(
      model_key + ": " + std::to_string(entries.size()) + " tensors, expected " + std::to_string(wanted.size()),
      entries.size() == wanted.size() && entries.size() == spec.at("n_tensors").get<std::size_t>());
  std::int64_t elements = 0, trainable = 0;
  for (std::size_t i = 0; i < entries.size() && i < wanted.size(); ++i) {
    const models::StateEntry& entry = entries[i];
    Json found;
    found["key"] = entry.key;
    found["shape"] = entry.tensor.sizes().vec();
    found["dtype"] = dtypes[i] == torch::kHalf ? "float16" : dtypes[i] == torch::kFloat32 ? "float32" : "int64";
    found["kind"] = entry.is_buffer ? "buffer" : "parameter";
    found["requires_grad"] = entry.tensor.requires_grad();
    elements += entry.tensor.numel();
    trainable += entry.tensor.requires_grad() ? entry.tensor.numel() : 0;
    bool equal = true;
    for (const auto& [field, value] : found.items()) equal = equal && wanted[i].at(field) == value;
    if (!equal) fixture.check_true(found.dump() + ", expected " + wanted[i].dump(), false);
  }
  fixture.check_true(model_key + ": " + std::to_string(elements) + " elements",
                     elements == spec.at("n_elements").get<std::int64_t>());
  fixture.check_true(model_key + ": " + std::to_string(trainable) + " trainable elements",
                     trainable == spec.at("n_trainable").get<std::int64_t>());
}

// The published arguments (reference autoencoders.md, 1).
constexpr const char* kSkinAutoEncoderArguments = R"({
  "encoder_config": {
    "skin_feat_channels": 4, "skl_pos_embed_freq": 12,
    "jp_embedder_config": {"hidden_dim": 1024, "depth": 6, "jp_embed_attn": true},
    "jp_embed_dim": 1024, "relative_pe": true, "vert_feat_is_linear": true, "normalize_feat": true},
  "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 64, "num_blocks": 4,
                     "vert_cross_blocks_num": 0},
  "use_fp16": true})";

void run_skin_ae_spec(Fixture& fixture) {
  const Json arguments = parse_json(kSkinAutoEncoderArguments, "published config");
  models::SkinAutoEncoder model(models::SkinAutoEncoderOptions::from_json(arguments), nn::Init::kNone);
  compare(fixture, "model", *model, model->half_precision_modules());
}

void run_state_dict_spec(Fixture& fixture) {
  if (fixture.json().at("config") == "anigen_skin_ae.json") return run_skin_ae_spec(fixture);
  throw NotBuiltYet{fixture.json().at("config").get<std::string>()};
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(state_dict_spec, anigen::test::run_state_dict_spec)
