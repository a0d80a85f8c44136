// Full-size key listings: a model built from the published config must have the same keys, order, shapes, run-time
// dtypes, kinds and trainable flags.
#include <cstdio>
#include <filesystem>

#include "anigen/core/config.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/structured_latent/flow.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void compare(Fixture& fixture, const std::string& model_key, const torch::nn::Module& module,
             const std::vector<std::string>& half_precision_modules) {
  const Json& spec = fixture.json().at("models").at(model_key);
  const std::vector<nn::StateEntry> entries = nn::state_entries(module);
  const std::vector<torch::Dtype> dtypes = nn::published_dtypes(module, half_precision_modules);
  const Json& wanted = spec.at("tensors");
  fixture.check_true(
      model_key + ": " + std::to_string(entries.size()) + " tensors, expected " + std::to_string(wanted.size()),
      entries.size() == wanted.size() && entries.size() == spec.at("n_tensors").get<std::size_t>());
  std::int64_t elements = 0, trainable = 0;
  for (std::size_t i = 0; i < entries.size() && i < wanted.size(); ++i) {
    const nn::StateEntry& entry = entries[i];
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

// The shipped config of that name.
Json published_config(const std::string& name) {
  return load_config(std::filesystem::path(ANIGEN_SOURCE_DIR) / "configs" / "published" / name);
}

template <typename Model, typename Options>
void compare_published(Fixture& fixture, const Json& config, const std::string& model_key) {
  const Json& arguments = config.at("models").at(model_key).at("args");
  Model model(Options::from_json(arguments, "published config", "/models/" + model_key + "/args"), nn::Init::kNone);
  compare(fixture, model_key, *model, model->half_precision_modules());
}

void run_state_dict_spec(Fixture& fixture) {
  const std::string name = fixture.json().at("config");
  if (name == "anigen_skin_ae.json") {
    compare_published<skin_field::SkinAutoEncoder, skin_field::SkinAutoEncoderOptions>(fixture, published_config(name),
                                                                                       "model");
  } else if (name == "ss_dae.json") {
    const Json config = published_config(name);
    compare_published<sparse_structure::SparseStructureEncoder, sparse_structure::SparseStructureEncoderOptions>(
        fixture, config, "encoder");
    compare_published<sparse_structure::SparseStructureDecoder, sparse_structure::SparseStructureDecoderOptions>(
        fixture, config, "decoder");
  } else if (name == "ss_flow_duet.json") {
    compare_published<sparse_structure::SparseStructureFlow, sparse_structure::SparseStructureFlowOptions>(
        fixture, published_config(name), "denoiser");
  } else if (name == "slat_dae.json") {
    const Json config = published_config(name);
    compare_published<structured_latent::StructuredLatentEncoder, structured_latent::StructuredLatentEncoderOptions>(
        fixture, config, "encoder");
    compare_published<structured_latent::StructuredLatentDecoder, structured_latent::StructuredLatentDecoderOptions>(
        fixture, config, "decoder");
  } else if (name == "slat_flow_auto.json" || name == "slat_flow_control.json") {
    compare_published<structured_latent::StructuredLatentFlow, structured_latent::StructuredLatentFlowOptions>(
        fixture, published_config(name), "denoiser");
  } else {
    throw NotBuiltYet{name};
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(state_dict_spec, anigen::test::run_state_dict_spec)
