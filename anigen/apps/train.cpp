#include <string>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/ranges.h"
#include "anigen/core/cores.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/blas.h"
#include "anigen/train/distributed/local_ranks.h"
#include "anigen/train/train_command.h"

int main(int argc, char** argv) {
  CLI::App app{
      "Trains one stage from one config. Run the same command again to go on where it stopped.\n\n"
      "  anigen-train --config configs/tiny/skin_ae.json --data-dir data/tiny --output runs/skin_ae\n"
      "  anigen-train --output runs/skin_ae                     go on with the config of that run\n"
      "  anigen-train --output runs/skin_ae --ckpt 200 --restart  go back to step 200; later steps are moved aside\n"
      "  anigen-train --config FILE --output runs/b --set trainer.args.optimizer.args.lr=3e-4\n"
      "  anigen-train --ranks 2 --restarts 3 --config FILE --output runs/b --set trainer.args.batch_split=2\n"
      "  srun --ntasks 8 anigen-train --config FILE --output runs/b      or torchrun, or mpirun: docs/cluster.md\n"};
  anigen::CommonOptions common;
  anigen::train::TrainCommand command;
  std::string warm_start, rendezvous, communication = "fp32";
  anigen::train::LocalRanks local;
  app.add_option("--config", command.config, "JSON config; default: config.json of the output folder");
  app.add_option("--output", command.run.output, "Run folder")->required();
  app.add_option("--data-dir", command.data_dir, "Dataset root, or several separated by commas");
  app.add_option("--set", command.overrides, "path.to.key=value overrides a config value; repeatable")
      ->allow_extra_args(false);
  app.add_option("--load", command.run.load,
                 "Start from a checkpoint of this other run folder; ignored once the output folder has its own");
  app.add_option("--warm-start", warm_start,
                 "Folder of pretrained weights (<class name>.safetensors or .pt) for the branches that published "
                 "runs take from TRELLIS; none: train those too [config's trainer.args.pretrained_dir]");
  app.add_option("--ckpt", command.run.ckpt,
                 "latest, none, or a step to start from; ignored once the output folder has checkpoints, so that the "
                 "same command goes on however often it is started")
      ->capture_default_str();
  app.add_flag("--restart", command.run.restart,
               "Begin again as --load and --ckpt say although the output folder has checkpoints: later steps move to "
               "ckpts/abandoned-STEP-N there. The same command goes on with what it began until that run has ended");
  app.add_option("--profile", command.run.profile_steps,
                 "Measure where the time of so many steps goes, after two that warm up, into profile.md of the run")
      ->check(anigen::whole_number(0, 1'000'000));
  CLI::Option* ranks = app.add_option("--ranks", local.ranks, "Train by so many processes of this machine")
                           ->check(anigen::whole_number(1, 1024));
  app.add_option("--restarts", local.restarts,
                 "With --ranks: start all again from the last checkpoint, so often, after one has failed")
      ->check(anigen::whole_number(0, 1'000'000))
      ->needs(ranks);
  app.add_option("--rendezvous", rendezvous,
                 "Where ranks find each other, tcp://HOST:PORT of rank 0 or file:///PATH [the launcher's environment]");
  app.add_option("--timeout", command.ranks.timeout, "Seconds without a sign of life after which a rank is lost")
      ->capture_default_str()
      ->check(anigen::number(5, 86400));
  app.add_option("--communication", communication, "Gradients travel between ranks in fp32 or bf16")
      ->capture_default_str()
      ->check(CLI::IsMember({"fp32", "bf16"}));
  anigen::add_common_options(app, common, anigen::nn::version_details,
                             {{"--json", "prints no results: metrics.csv of the run folder has them"}});
  for (int i = 0; i < argc; ++i) command.command_line += (i ? " " : "") + std::string(argv[i]);
  int status_of_ranks = 0;
  const int status = anigen::run_command(app, common, argc, argv, [&] {
    command.environment = anigen::train::read_launch_environment(rendezvous);
    const anigen::train::LaunchEnvironment& environment = command.environment;
    if (local.ranks == 1)
      anigen::refuse_given(app, {"--restarts"}, "starts the processes of --ranks again, of which it needs two or more");
    if (ranks->count() == 0 && environment.launcher.empty()) {
      anigen::refuse_given(app, {"--timeout", "--communication"},
                           "is for several processes: there is neither --ranks nor a launcher");
    }
    if (local.ranks > 1 && environment.launcher.empty()) {
      local.timeout = command.ranks.timeout;
      status_of_ranks = anigen::train::run_local_ranks(local, std::vector<std::string>(argv, argv + argc));
      return;
    }
    if (local.ranks > 1 && local.ranks != environment.size) {
      throw anigen::InputError(
          "--ranks", std::to_string(local.ranks),
          environment.launcher + " has started " + std::to_string(environment.size) + "; leave the option out");
    }
    if (common.threads == 0 && environment.local_size > 1) {
      anigen::set_thread_count(anigen::shared_thread_count(anigen::find_cores(), environment.local_size));
    }
    command.device = common.device;
    command.run.threads = anigen::thread_count();
    command.ranks.sent = communication == "bf16" ? torch::kBFloat16 : torch::kFloat32;
    if (common.seed_given) command.overrides.push_back("trainer.args.seed=" + std::to_string(common.seed));
    if (!warm_start.empty()) {
      command.overrides.push_back(warm_start == "none" ? std::string("trainer.args.warm_start=none")
                                                       : "trainer.args.pretrained_dir=" + warm_start);
    }
    anigen::train::train(command);
  });
  return status != 0 ? status : status_of_ranks;
}
