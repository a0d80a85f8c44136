#include "anigen/apps/common/command_line.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/blas.h"
#include "anigen/train/train_command.h"

int main(int argc, char** argv) {
  CLI::App app{
      "Trains one stage from one config. Run the same command again to go on where it stopped.\n\n"
      "  anigen-train --config configs/tiny/skin_ae.json --data-dir data/tiny --output runs/skin_ae\n"
      "  anigen-train --output runs/skin_ae                     go on with the config of that run\n"
      "  anigen-train --config FILE --output runs/b --set trainer.args.optimizer.args.lr=3e-4\n"};
  anigen::CommonOptions common;
  anigen::train::TrainCommand command;
  std::string warm_start;
  app.add_option("--config", command.config, "JSON config; default: config.json of the output folder");
  app.add_option("--output", command.run.output, "Run folder")->required();
  app.add_option("--data-dir", command.data_dir, "Dataset root, or several separated by commas");
  app.add_option("--set", command.overrides, "path.to.key=value overrides a config value; repeatable")
      ->allow_extra_args(false);
  app.add_option("--load", command.run.load, "Start from a checkpoint of this other run folder");
  app.add_option("--warm-start", warm_start,
                 "Folder of pretrained weights (<class name>.safetensors or .pt) for the branches that published "
                 "runs take from TRELLIS; none: train those too [config's trainer.args.pretrained_dir]");
  app.add_option("--ckpt", command.run.ckpt, "latest, none, or a step")->capture_default_str();
  app.add_option("--profile", command.run.profile_steps,
                 "Measure where the time of so many steps goes, after two that warm up, into profile.md of the run")
      ->check(CLI::NonNegativeNumber);
  anigen::add_common_options(app, common, anigen::nn::version_details);
  for (int i = 0; i < argc; ++i) command.command_line += (i ? " " : "") + std::string(argv[i]);
  return anigen::run_command(app, common, argc, argv, [&] {
    command.device = common.device;
    command.run.threads = anigen::thread_count();
    if (common.seed_given) command.overrides.push_back("trainer.args.seed=" + std::to_string(common.seed));
    if (!warm_start.empty()) {
      command.overrides.push_back(warm_start == "none" ? std::string("trainer.args.warm_start=none")
                                                       : "trainer.args.pretrained_dir=" + warm_start);
    }
    anigen::train::train(command);
  });
}
