// The skin auto-encoder: outputs, and gradients of the sum of squares of everything it returns.
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void run_skin_ae(Fixture& fixture) {
  const auto options =
      skin_field::SkinAutoEncoderOptions::from_json(fixture.config(), fixture.name() + ".json", "/config");
  skin_field::SkinAutoEncoder model(options, nn::Init::kNone);
  load_whole(model, fixture);

  const auto output = model->forward(fixture.inputs("joints"), fixture.inputs("parents"), fixture.inputs("skin"));
  torch::Tensor sum = torch::zeros({1}, fixture.device());
  for (std::size_t i = 0; i < output.skin.size(); ++i) {
    const std::string item = "." + std::to_string(i);
    fixture.check("joint_embeds" + item, output.joint_embeds[i]);
    fixture.check("vert_embeds" + item, output.vert_embeds[i]);
    fixture.check("skin" + item, output.skin[i]);
    for (const auto& list : {output.joint_embeds, output.vert_embeds, output.skin}) sum = sum + list[i].square().sum();
  }
  fixture.check("S", sum);
  sum.backward();
  const std::string prefix = "grad.";
  for (const nn::StateEntry& entry : nn::state_entries(*model)) {
    for (const std::string& name : fixture.outputs()) {
      if (name == prefix + entry.key) fixture.check(name, entry.tensor.grad());
    }
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(skin_ae, anigen::test::run_skin_ae)
