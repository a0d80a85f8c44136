#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/error.h"

int main(int argc, char** argv) {
  using namespace anigen;
  Program program(
      "anigen-train", "Trains one stage from one config. Run the same command again to go on where it stopped.",
      "  anigen-train --config configs/tiny/skin_ae.json -d data/tiny -o runs/skin_ae\n"
      "  anigen-train -o runs/skin_ae                         go on with the config of that run\n"
      "  anigen-train -o runs/skin_ae --ckpt 200 --restart    go back to step 200; later steps are moved aside\n"
      "  anigen-train --config FILE -o runs/b --set trainer.args.optimizer.args.lr=3e-4\n"
      "  anigen-train --config FILE -o runs/b --tune          find the fastest settings; then: anigen-train -o runs/b\n"
      "  anigen-train -o runs/slat_dae --export weights/own   its weights in half precision, to hand on\n"
      "  anigen-train --config FILE --print-config            the config with every default\n"
      "  anigen-train --ranks 2 --rank-restarts 3 --config FILE -o runs/b --set trainer.args.batch_split=2\n"
      "  srun --ntasks 8 anigen-train --config FILE -o runs/b      or torchrun, or mpirun: docs/cluster.md");
  CLI::App& app = program.app;
  TrainArguments arguments;
  add_option(app, "--config", arguments.config);
  add_option(app, "--output", arguments.output, ": run folder");
  add_option(app, "--dataset", arguments.dataset, ", or several separated by commas [the config's]");
  add_option(app, "--set", arguments.overrides)->allow_extra_args(false);
  add_option(app, "--load", arguments.load);
  add_option(app, "--warm-start", arguments.warm_start);
  add_option(app, "--ckpt", arguments.ckpt,
             ": latest, none, or a step to start from; ignored once the output folder has checkpoints, so that the "
             "same command goes on however often it is started");
  add_option(app, "--restart", arguments.restart);
  add_option(app, "--extend-to", arguments.extend_to)->check(whole_number(1, std::uint64_t{1} << 40));
  add_option(app, "--profile", arguments.profile_steps)->check(whole_number(0, 1'000'000));
  add_option(app, "--tune", arguments.tune);
  CLI::Option* export_to = add_option(app, "--export", arguments.export_to);
  add_option(app, "--export-precision", arguments.export_precision)->needs(export_to);
  add_option(app, "--schema", arguments.schema);
  add_option(app, "--print-config", arguments.print_config);
  CLI::Option* ranks = add_option(app, "--ranks", arguments.ranks)->check(whole_number(1, 1024));
  add_option(app, "--rank-restarts", arguments.rank_restarts)->check(whole_number(0, 1'000'000))->needs(ranks);
  add_option(app, "--rendezvous", arguments.rendezvous);
  add_option(app, "--rank-timeout", arguments.rank_timeout)->check(number(5, 86400));
  add_option(app, "--communication", arguments.communication);
  program.add_common({"--seed [the config's]", "--threads", "--device"}, library_versions());
  int status_of_ranks = 0;
  program.check = [&] {
    if (arguments.output.empty() && !arguments.schema && !arguments.print_config)
      throw InputError("", "--output", "name the run folder");
    if (arguments.ranks == 1)
      refuse_given(app, {"--rank-restarts"}, "starts the processes of --ranks again, of which it needs two or more");
    if (program.only_checks() && !arguments.config.empty())
      torch_half("the check of a config").check_config(arguments, program.common);
  };
  const int status = program.run(argc, argv, [&] {
    arguments.words = program.words;
    arguments.ranks_given = ranks->count() > 0;
    for (const char* name : {"--rank-timeout", "--communication"}) {
      if (app.get_option(name)->count() > 0) arguments.only_of_ranks.emplace_back(name);
    }
    status_of_ranks = torch_half("training").train(arguments, program.common);
  });
  return status != 0 ? status : status_of_ranks;
}
