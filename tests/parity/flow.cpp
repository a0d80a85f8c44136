// The flow-matching objective: time schedules, noising, velocities, condition dropout and losses, with a stand-in for
// the network.
#include "anigen/flow/matching.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

flow::TimeSchedule schedule_of(const Fixture& fixture) {
  return flow::TimeSchedule::from_json(fixture.config().at("t_schedule"), fixture.name() + ".json",
                                       "/config/t_schedule");
}

void run_time_sampling(Fixture& fixture) {
  const double sigma_min = fixture.config().at("sigma_min");
  const Tensor t = schedule_of(fixture).from_draws(fixture.input("normals"));
  flow::TimeSchedule uniform;
  uniform.kind = flow::TimeSchedule::Kind::kUniform;
  const Tensor x_0 = fixture.input("x_0"), noise = fixture.input("noise");
  const Tensor x_t = flow::noisy(x_0, noise, t, sigma_min), v = flow::velocity_target(x_0, noise, sigma_min);
  fixture.check("t", t);
  fixture.check("t_uniform", uniform.from_draws(fixture.input("uniforms")));
  fixture.check("x_t", x_t);
  fixture.check("x_t_skl", flow::noisy(fixture.input("x_0_skl"), fixture.input("noise_skl"), t, sigma_min));
  fixture.check("v", v);
  fixture.check("x_0_rec", flow::x0_from_velocity(x_t, v, t, sigma_min));
  fixture.check("model_t", flow::model_time(t));
  fixture.check("time_bin", flow::time_bin(t));
}

// One stream of the losses of ops_train_flow_losses, whose notes define the stand-in: 0.3 x_t + shift per item.
struct StandInError {
  Tensor prediction, target;
};

StandInError stand_in_error(const Tensor& x_0, const Tensor& noise, const Tensor& t, const Tensor& shift,
                            double sigma_min) {
  std::vector<std::int64_t> shape(static_cast<std::size_t>(x_0.dim()), 1);
  shape[0] = x_0.size(0);
  const Tensor x_t = flow::noisy(x_0, noise, t, sigma_min);
  return {0.3 * x_t + shift.view(shape), flow::velocity_target(x_0, noise, sigma_min)};
}

Tensor mean_error(const StandInError& error) { return (error.prediction - error.target).square().mean(); }

void check_dense(Fixture& fixture, const Tensor& t, double sigma_min) {
  const Tensor dropped = fixture.input("cfg_u") < fixture.config().at("p_uncond").get<double>();
  const Tensor cond = flow::replace_condition(fixture.input("cond"), dropped, fixture.input("neg_cond"));
  fixture.check("cond_used", cond);
  const Tensor shift = 0.1 * cond.flatten(1).mean(1) + flow::model_time(t) / 1000.0;
  const StandInError shape = stand_in_error(fixture.input("x_0"), fixture.input("noise"), t, shift, sigma_min);
  const StandInError skeleton =
      stand_in_error(fixture.input("x_0_skl"), fixture.input("noise_skl"), t, shift, sigma_min);
  const Tensor mse = mean_error(shape), mse_skl = mean_error(skeleton);
  fixture.check("mse", mse);
  fixture.check("mse_skl", mse_skl);
  fixture.check("loss", mse + mse_skl);
  fixture.check("bin_mse", flow::mean_per_time_bin(flow::mse_per_item(shape.prediction, shape.target), t));
  fixture.check("bin_mse_skl", flow::mean_per_time_bin(flow::mse_per_item(skeleton.prediction, skeleton.target), t));
}

Tensor sparse_error(Fixture& fixture, const std::string& suffix, const Tensor& t, double sigma_min) {
  const Tensor items = fixture.input("coords" + suffix).select(1, 0).to(torch::kInt64);
  const Tensor times = t.index_select(0, items);
  return mean_error(stand_in_error(fixture.input("feats" + suffix), fixture.input("noise_feats" + suffix), times,
                                   flow::model_time(times) / 1000.0, sigma_min));
}

void run_flow_losses(Fixture& fixture) {
  const double sigma_min = fixture.config().at("sigma_min");
  const Tensor t = schedule_of(fixture).from_draws(fixture.input("normals"));
  check_dense(fixture, t, sigma_min);
  const Tensor mse = sparse_error(fixture, "", t, sigma_min), mse_skl = sparse_error(fixture, "_skl", t, sigma_min);
  fixture.check("sparse_mse", mse);
  fixture.check("sparse_mse_skl", mse_skl);
  fixture.check("sparse_loss", mse + mse_skl);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_train_t_sampling, anigen::test::run_time_sampling)
ANIGEN_DEVICE_PARITY(ops_train_flow_losses, anigen::test::run_flow_losses)
