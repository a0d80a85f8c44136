#include <string>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/train_arguments.h"

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
  anigen::TrainArguments arguments;
  app.add_option("--config", arguments.config, "JSON config; default: config.json of the output folder");
  app.add_option("--output", arguments.output, "Run folder")->required();
  app.add_option("--data-dir", arguments.data_dir, "Dataset root, or several separated by commas");
  app.add_option("--set", arguments.overrides, "path.to.key=value overrides a config value; repeatable")
      ->allow_extra_args(false);
  app.add_option("--load", arguments.load,
                 "Start from a checkpoint of this other run folder; ignored once the output folder has its own");
  app.add_option("--warm-start", arguments.warm_start,
                 "Folder of pretrained weights (<class name>.safetensors or .pt) for the branches that published "
                 "runs take from TRELLIS; none: train those too [config's trainer.args.pretrained_dir]");
  app.add_option("--ckpt", arguments.ckpt,
                 "latest, none, or a step to start from; ignored once the output folder has checkpoints, so that the "
                 "same command goes on however often it is started")
      ->capture_default_str();
  app.add_flag("--restart", arguments.restart,
               "Begin again as --load and --ckpt say although the output folder has checkpoints: later steps move to "
               "ckpts/abandoned-STEP-N there. The same command goes on with what it began until that run has ended");
  app.add_option("--profile", arguments.profile_steps,
                 "Measure where the time of so many steps goes, after two that warm up, into profile.md of the run")
      ->check(anigen::whole_number(0, 1'000'000));
  CLI::Option* ranks = app.add_option("--ranks", arguments.ranks, "Train by so many processes of this machine")
                           ->check(anigen::whole_number(1, 1024));
  app.add_option("--restarts", arguments.restarts,
                 "With --ranks: start all again from the last checkpoint, so often, after one has failed")
      ->check(anigen::whole_number(0, 1'000'000))
      ->needs(ranks);
  app.add_option("--rendezvous", arguments.rendezvous,
                 "Where ranks find each other, tcp://HOST:PORT of rank 0 or file:///PATH [the launcher's environment]");
  app.add_option("--timeout", arguments.timeout, "Seconds without a sign of life after which a rank is lost")
      ->capture_default_str()
      ->check(anigen::number(5, 86400));
  app.add_option("--communication", arguments.communication, "Gradients travel between ranks in fp32 or bf16")
      ->capture_default_str()
      ->check(CLI::IsMember({"fp32", "bf16"}));
  anigen::add_common_options(app, common, anigen::library_versions(),
                             {{"--json", "prints no results: metrics.csv of the run folder has them"}});
  int status_of_ranks = 0;
  const int status = anigen::run_command(app, common, argc, argv, [&] {
    if (arguments.ranks == 1)
      anigen::refuse_given(app, {"--restarts"}, "starts the processes of --ranks again, of which it needs two or more");
    arguments.words.assign(argv, argv + argc);
    arguments.ranks_given = ranks->count() > 0;
    for (const char* name : {"--timeout", "--communication"}) {
      if (app.get_option(name)->count() > 0) arguments.only_of_ranks.emplace_back(name);
    }
    status_of_ranks = anigen::torch_half("training").train(arguments, common);
  });
  return status != 0 ? status : status_of_ranks;
}
