// Resampling of skin weights on the surface, and the losses of the skin auto-encoder with a gradient.
#include "anigen/skin_field/loss.h"

#include "anigen/skin_field/sampling.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void run_skin_loss(Fixture& fixture) {
  fixture.check("probs", skin_field::face_probabilities(fixture.input("vertices"), fixture.input("faces")));
  fixture.check("sampled_skin", skin_field::interpolate_skin(fixture.host_input("skin"), fixture.host_input("faces"),
                                                             fixture.host_input("face_draw"), fixture.host_input("u"),
                                                             fixture.host_input("v")));

  std::vector<torch::Tensor> predicted, target, log_predicted;
  for (int i = 0; fixture.has_input("pred" + std::to_string(i)); ++i) {
    predicted.push_back(fixture.input("pred" + std::to_string(i)).requires_grad_());
    target.push_back(fixture.input("gt" + std::to_string(i)));
    log_predicted.push_back(predicted.back().detach().log());
  }
  skin_field::SkinLossOptions options;
  options.lambda_kl_skin = fixture.config().at("lambda_kl_skin");
  options.lambda_l1_skin = fixture.config().at("lambda_l1_skin");
  options.lambda_l2_skin = fixture.config().at("lambda_l2_skin");
  const skin_field::SkinLosses losses = skin_field::skin_losses(predicted, target, options);
  losses.total.backward();
  fixture.check("skin_kl_loss", losses.kl);
  fixture.check("skin_l1_loss", losses.l1);
  fixture.check("skin_l2_loss", losses.l2);
  fixture.check("grad_pred0", predicted[0].grad());

  // Losses from logarithms, which is what training uses.
  const skin_field::SkinLosses from_log = skin_field::skin_losses_from_log(log_predicted, target, options);
  fixture.check("skin_kl_loss", from_log.kl);
  fixture.check("skin_l1_loss", from_log.l1);
  fixture.check("skin_l2_loss", from_log.l2);

  options.kl_mean = skin_field::SkinKlMean::kRows;
  fixture.check("kl_batchmean_for_comparison", skin_field::skin_losses(predicted, target, options).kl);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_loss_skin_ae, anigen::test::run_skin_loss)
