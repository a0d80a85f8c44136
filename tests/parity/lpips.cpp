// LPIPS as a loss: VGG16 trunk by the fixture's formula, published linear heads.
#include "anigen/vision/lpips.h"

#include "anigen/nn/state_dict.h"
#include "tests/parity/registry.h"
#include "tests/vision/lpips_formula.h"

namespace anigen::test {
namespace {

using torch::Tensor;

/// The fixture stores the heads flattened, as "lin0" … "lin4".
io::NamedArrays heads_of(const Fixture& fixture) {
  std::vector<std::vector<float>> heads;
  const io::NamedArrays parameters = fixture.parameters();
  for (std::size_t s = 0; s < vision::kLpipsStages; ++s) {
    const io::NdArray* head = io::find(parameters, "lin" + std::to_string(s));
    if (head == nullptr) throw std::runtime_error("the fixture has no head lin" + std::to_string(s));
    heads.push_back(head->as<float>());
  }
  return lpips_heads(heads);
}

void run_lpips(Fixture& fixture) {
  fixture.check_true("version 0.1", fixture.config().at("version") == "0.1");
  vision::Lpips lpips;
  vision::set_lpips_weights(*lpips, {{"formula", formula_trunk()}, {fixture.name(), heads_of(fixture)}});

  std::vector<Tensor> weights, biases;
  for (const nn::StateEntry& entry : nn::state_entries(*lpips)) {
    if (entry.key.rfind("features.", 0) != 0) continue;
    const Tensor flat = entry.tensor.flatten();
    if (entry.tensor.dim() == 4) {
      const Tensor mean = flat.abs().to(torch::kFloat64).mean().to(torch::kFloat32);
      weights.push_back(torch::cat({flat.slice(0, 0, 3), mean.reshape({1})}));
    } else {
      biases.push_back(flat.slice(0, 0, 3));
    }
  }
  fixture.check("weight_check", torch::stack(weights));
  fixture.check("bias_check", torch::stack(biases));

  const Tensor a = fixture.input("img1").requires_grad_(), b = fixture.input("img2");
  const Tensor per_image = lpips(a, b), value = per_image.mean();
  value.backward();
  fixture.check("per_image", per_image);
  fixture.check("value", value);
  fixture.check("grad_img1", a.grad());
  const torch::NoGradGuard no_grad;
  fixture.check("per_layer", lpips->stages(a, b));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_loss_lpips_vgg_formula, anigen::test::run_lpips)
