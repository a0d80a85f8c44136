// Anymate's connectivity and skinning heads, and how its samples become batches.
#include "anigen/anymate/heads.h"
#include "anigen/anymate/model.h"
#include "tests/parity/anymate_parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_collate(Fixture& fixture) {
  std::vector<anymate::AnymateSample> samples;
  for (std::size_t i = 0; fixture.has_input("s" + std::to_string(i) + ".joints"); ++i) {
    const std::string prefix = "s" + std::to_string(i) + ".";
    anymate::AnymateSample sample;
    sample.joints = fixture.input(prefix + "joints");
    sample.conns = fixture.input(prefix + "conns");
    sample.bones = fixture.input(prefix + "bones");
    sample.skins_index = fixture.input(prefix + "skins_index");
    sample.skins_weight = fixture.input(prefix + "skins_weight");
    samples.push_back(sample);
  }
  const anymate::AnymateBatch batch = anymate::collate(samples);
  fixture.check("joints", batch.joints);
  fixture.check("bones", batch.bones);
  fixture.check("conns", batch.conns);
  fixture.check("joints_mask", batch.joints_mask);
  fixture.check("bones_mask", batch.bones_mask);
  const auto rows = fixture.config().at("rows").get<std::vector<std::int64_t>>();
  fixture.check("skins_rows", batch.skins.index_select(1, torch::tensor(rows, torch::kInt64)));
  fixture.check("joints_repeat",
                anymate::collate_diffusion(samples, anymate_size(fixture, "return_joints_num")).joints_repeat);
}

void check_connectivity(Fixture& fixture, anymate::ConnectivityImpl& model) {
  const Tensor latents = input_with_gradient(fixture, "latents");
  const Tensor logits = model.forward(latents, fixture.input("joints"), fixture.input("joints_mask"));
  const Tensor loss = anymate::connectivity_loss(logits, fixture.input("conns"));
  loss.backward();
  fixture.check("logits", logits);
  fixture.check("loss", loss);
  fixture.check("grad_latents", latents.grad());
}

void run_conn_combine(Fixture& fixture) {
  anymate::TwoBranchConnectivity model(anymate_head(fixture), anymate_size(fixture, "layers"), nn::Init::kNone);
  load_all(model, fixture);
  check_connectivity(fixture, *model);
}

void run_conn_token(Fixture& fixture) {
  anymate::TokenConnectivity model(anymate_head(fixture), anymate_size(fixture, "layers"),
                                   anymate_size(fixture, "head_token_length"), nn::Init::kNone);
  load_all(model, fixture);
  check_connectivity(fixture, *model);
}

anymate::SkinningInput skinning_input(const Fixture& fixture) {
  return {input_with_gradient(fixture, "latents"), fixture.input("points_cloud"), fixture.input("bones"),
          fixture.input("bones_mask")};
}

// @return the logits
Tensor check_skinning(Fixture& fixture, anymate::SkinningImpl& model) {
  const anymate::SkinningInput input = skinning_input(fixture);
  const Tensor logits = model.forward(input);
  const anymate::SkinningLosses losses = anymate::skinning_losses(logits, fixture.input("skins"));
  losses.cos_clamp.backward();
  fixture.check("logits", logits);
  fixture.check("cos", losses.cos);
  fixture.check("cos_clamp", losses.cos_clamp);
  fixture.check("ce", losses.ce);
  fixture.check("grad_latents", input.latents.grad());
  return logits.detach();
}

void run_skin_cross(Fixture& fixture) {
  const std::int64_t layers = anymate_size(fixture, "layers");
  anymate::CrossSkinning model(anymate_head(fixture), layers, false, nn::Init::kNone);
  load_part(model, fixture, "a");
  check_skinning(fixture, *model);
  anymate::CrossSkinning separate(anymate_head(fixture), layers, true, nn::Init::kNone);
  load_part(separate, fixture, "b");

  const torch::NoGradGuard no_grad;
  anymate::SkinningInput input = skinning_input(fixture);
  fixture.check("logits_separate", separate(input));
  input.points = fixture.input("vertices");
  fixture.check("logits_vertices", model(input, /*chunk=*/4));
}

void run_skin_concat(Fixture& fixture) {
  anymate::ConcatSkinningOptions options;
  options.layers = anymate_size(fixture, "layers");
  options.concat_num = anymate_size(fixture, "concat_num");
  options.tiled_masks = true;
  anymate::ConcatSkinning model(anymate_head(fixture), options, nn::Init::kNone);
  load_all(model, fixture);
  const Tensor logits = check_skinning(fixture, *model), points = fixture.input("points_cloud");
  fixture.check("nearest_skin",
                anymate::nearest_point_logits(fixture.input("vert"), points[0].slice(1, 0, 3), logits[0]));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_anymate_collate, anigen::test::run_collate)
ANIGEN_DEVICE_PARITY(ops_anymate_conn_combine, anigen::test::run_conn_combine)
ANIGEN_DEVICE_PARITY(ops_anymate_conn_token, anigen::test::run_conn_token)
ANIGEN_DEVICE_PARITY(ops_anymate_skin_cross, anigen::test::run_skin_cross)
ANIGEN_DEVICE_PARITY(ops_anymate_skin_concat, anigen::test::run_skin_concat)
