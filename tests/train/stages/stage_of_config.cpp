#include "tests/train/stages/stage_of_config.h"

#include "anigen/core/config.h"
#include "anigen/train/stages/stages.h"

namespace anigen::test {

std::unique_ptr<train::Stage> stage_of_config(const std::string& config, const std::filesystem::path& data,
                                              const std::vector<std::string>& overrides, torch::Device device) {
  Json all = parse_json(config, "test");
  apply_overrides(all, overrides);
  all["dataset"]["args"]["data_dir"] = data.string();
  const Json trainer = all.at("trainer");
  ConfigReader args(trainer.at("args"), "test", "/trainer/args");
  const train::TrainerOptions options = train::TrainerOptions::read(args);
  auto made = train::make_stage(trainer.at("name").get<std::string>(), {all, "test", args, options, device});
  args.finish();
  return made;
}

void draw_weights(const train::Stage& stage) {
  const torch::NoGradGuard no_grad;
  torch::manual_seed(11);
  for (const nn::NamedModel& model : stage.models()) {
    for (const torch::Tensor& parameter : model.module->parameters())
      parameter.copy_(0.2 * torch::randn(parameter.sizes()));
  }
}

}  // namespace anigen::test
