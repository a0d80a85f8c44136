#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/experiment/command.h"

namespace {

using anigen::add_option;
using anigen::experiment::ExperimentCommand;

void add_options(CLI::App& command, ExperimentCommand& options) {
  add_option(command, "FILE", options.file)->required();
  add_option(command, "--output", options.place.out, ": folder of its jobs and its report [runs/<name of the file>]");
  add_option(command, "--scale", options.scale);
  add_option(command, "--set", options.overrides)->allow_extra_args(false);
  add_option(command, "--programs", options.place.programs);
  add_option(command, "--accept-other-code", options.accept_other_code);
}

}  // namespace

int main(int argc, char** argv) {
  anigen::Program program(
      "anigen-experiment",
      "Runs a whole experiment from one file: data, trainings, variants, seeds, evaluation, report. What several\n"
      "variants share runs once; run the same command again to go on. docs/experiments.md explains the file.",
      "  anigen-experiment run experiments/quickstart.json\n"
      "  anigen-experiment run experiments/ablation_adapters.json --dry-run      what would run, and for how long\n"
      "  anigen-experiment status experiments/ablation_adapters.json\n"
      "  anigen-experiment run FILE --emit slurm && runs/FILE/slurm/submit.sh --partition gpu --gpus 1\n"
      "  anigen-experiment clean FILE --dry-run                                  results nothing needs any more");
  ExperimentCommand options;
  std::string scheduler;
  program.app.require_subcommand(1);
  CLI::App& run = program.command("run", "Run what is not done, then write the report");
  CLI::App& status = program.command("status", "Show what is done, running, failed and still to do");
  CLI::App& report = program.command("report", "Write the report from what is done");
  CLI::App& clean = program.command("clean", "Remove results that the file no longer asks for");
  for (CLI::App* command : {&run, &status, &report, &clean}) add_options(*command, options);
  add_option(run, "--dry-run", options.dry_run);
  add_option(run, "--workers", options.jobs, ": jobs")->check(anigen::whole_number(1, 1024));
  CLI::Option* only = add_option(run, "--only", options.only, ": this job, or the jobs of this step");
  add_option(run, "--together", options.together)->needs(only);
  add_option(run, "--emit", scheduler);
  add_option(clean, "--dry-run", options.dry_run);
  program.add_common({"--threads", "--device", "--json"});
  return program.run(argc, argv, [&] {
    using What = ExperimentCommand::What;
    options.what = status.parsed()   ? What::kStatus
                   : report.parsed() ? What::kReport
                   : clean.parsed()  ? What::kClean
                                     : What::kRun;
    options.slurm = scheduler == "slurm";
    options.threads = program.common.threads;
    options.place.device = program.common.device;
    std::fputs(anigen::experiment::run_experiment_command(options, program.common.json).c_str(), stdout);
  });
}
