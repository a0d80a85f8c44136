// DINOv2: tokens, position embeddings, and the parameters of the published models.
#include "anigen/vision/dinov2.h"

#include "anigen/nn/init.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/state_dict.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

// The config without the keys that describe inputs.
vision::Dinov2Options options_of(const Fixture& fixture) {
  Json config = fixture.config();
  config.erase("nonsquare");
  return vision::Dinov2Options::from_json(config, fixture.name() + ".json", "/config");
}

vision::Dinov2 model_of(const Fixture& fixture) {
  vision::Dinov2 model(options_of(fixture));
  load_whole(model, fixture);
  return model;
}

// Every pixel repeated so that the picture gets its size.
Tensor enlarged(const Tensor& image, std::int64_t height, std::int64_t width) {
  return image.repeat_interleave(height / image.size(2), 2).repeat_interleave(width / image.size(3), 3);
}

void run_native(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  vision::Dinov2 model = model_of(fixture);
  const std::int64_t size = model->options().img_size;
  const vision::Dinov2Tokens tokens = model->forward(enlarged(fixture.input("base"), size, size));
  fixture.check("x_prenorm", tokens.x_prenorm);
  fixture.check("x_norm_clstoken", tokens.norm_class());
  fixture.check("x_norm_regtokens", tokens.norm_registers());
  fixture.check("x_norm_patchtokens", tokens.norm_patches());
  fixture.check("cond", nn::layer_norm(tokens.x_prenorm, 1e-5));
}

constexpr std::int64_t kSmallSide = 224;  // "base224" in the fixtures' names

void run_registers(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  vision::Dinov2 model = model_of(fixture);
  const std::int64_t patch = model->options().patch_size;
  const Tensor images = enlarged(fixture.input("base224"), kSmallSide, kSmallSide);
  const vision::Dinov2Tokens tokens = model->forward(images);
  fixture.check("pos224", model->positions(kSmallSide / patch, kSmallSide / patch));
  fixture.check("x224_prenorm", tokens.x_prenorm);
  fixture.check("x224_norm_patch", tokens.norm_patches());
  fixture.check("x224_norm_cls", tokens.norm_class());
  fixture.check("x224_inter", model->tokens_after(images, 1));

  const auto size = fixture.config().at("nonsquare").get<std::vector<std::int64_t>>();
  fixture.check("posns", model->positions(size[0] / patch, size[1] / patch));
  fixture.check("xns_prenorm", model->forward(enlarged(fixture.input("basens"), size[0], size[1])).x_prenorm);
}

void run_plain(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  vision::Dinov2 model = model_of(fixture);
  const vision::Dinov2Tokens tokens = model->forward(enlarged(fixture.input("base224"), kSmallSide, kSmallSide));
  fixture.check("x_prenorm", tokens.x_prenorm);
  fixture.check("x_norm_clstoken", tokens.norm_class());
  fixture.check("x_norm_patchtokens", tokens.norm_patches());
}

void run_positions(Fixture& fixture) {
  const Json& config = fixture.config();
  const std::int64_t patch = config.at("patch_size");
  Tensor embedding;
  for (const auto& [key, array] : fixture.parameters()) {
    if (key == "pos_embed") embedding = nn::to_tensor(array);
  }
  for (const auto& [name, flags] : config.at("flags").items()) {
    for (const Json& size : config.at("sizes")) {
      const std::int64_t height = size.at(0), width = size.at(1);
      const Tensor found = vision::interpolate_positions(
          embedding, height / patch, width / patch, flags.at("interpolate_antialias"), flags.at("interpolate_offset"));
      fixture.check(name + "_" + std::to_string(height) + "x" + std::to_string(width), found);
    }
  }
}

void run_keys(Fixture& fixture) {
  for (const auto& [name, spec] : fixture.json().at("models").items()) {
    const Json& wanted = spec.at("state_dict");
    const vision::Dinov2Options options = vision::Dinov2Options::named(name);
    fixture.check_true(name + ": the arguments of the name are the published ones",
                       options.to_json() == vision::Dinov2Options::from_json(spec.at("args")).to_json());
    const vision::Dinov2 model(options);
    const std::vector<nn::StateEntry> entries = nn::state_entries(*model);
    fixture.check_true(
        name + ": " + std::to_string(entries.size()) + " tensors, expected " + std::to_string(wanted.size()),
        entries.size() == wanted.size());
    std::int64_t elements = 0;
    std::size_t i = 0;
    for (const auto& [key, shape] : wanted.items()) {
      if (i >= entries.size()) break;
      const nn::StateEntry& entry = entries[i++];
      elements += entry.tensor.numel();
      const bool equal = entry.key == key && Json(entry.tensor.sizes().vec()) == shape && !entry.is_buffer &&
                         entry.tensor.scalar_type() == torch::kFloat32;
      if (!equal) fixture.check_true(name + ": " + entry.key + ", expected " + key + " " + shape.dump(), false);
    }
    fixture.check_true(name + ": " + std::to_string(elements) + " parameters",
                       elements == spec.at("num_parameters").get<std::int64_t>());
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_dinov2_reg_518, anigen::test::run_native)
ANIGEN_DEVICE_PARITY(ops_dinov2_reg_224, anigen::test::run_registers)
ANIGEN_DEVICE_PARITY(ops_dinov2_plain_224, anigen::test::run_plain)
ANIGEN_PARITY(ops_dinov2_pos_interp, anigen::test::run_positions)
ANIGEN_PARITY(ops_dinov2_state_dict_keys, anigen::test::run_keys)
