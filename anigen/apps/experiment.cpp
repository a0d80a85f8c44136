#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/experiment/command.h"

namespace {

using anigen::experiment::ExperimentCommand;

void add_options(CLI::App& command, ExperimentCommand& options) {
  command.fallthrough();
  command.add_option("FILE", options.file, "The experiment's JSON file")->required();
  command.add_option("--out", options.place.out, "Folder of its jobs and its report [runs/<name of the file>]");
  command.add_option("--set", options.overrides, "path.to.key=value overrides a value of the file; repeatable")
      ->allow_extra_args(false);
  command.add_option("--programs", options.place.programs, "Folder of the executables [that of this one]");
  command.add_flag("--accept-other-code", options.accept_other_code,
                   "Keep results of other builds of the programs when all else is the same");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Runs a whole experiment from one file: data, trainings, variants, seeds, evaluation, report. What several\n"
      "variants share runs once; run the same command again to go on. docs/experiments.md explains the file.\n\n"
      "  anigen-experiment run experiments/quickstart.json\n"
      "  anigen-experiment run experiments/ablation_adapters.json --dry-run      what would run, and for how long\n"
      "  anigen-experiment status experiments/ablation_adapters.json\n"
      "  anigen-experiment run FILE --emit slurm && runs/FILE/slurm/submit.sh --partition gpu --gpus 1\n"
      "  anigen-experiment clean FILE --dry-run                                  results nothing needs any more\n"};
  anigen::CommonOptions common;
  ExperimentCommand options;
  app.require_subcommand(1);
  CLI::App* run = app.add_subcommand("run", "Run what is not done, then write the report");
  add_options(*run, options);
  run->add_flag("--dry-run", options.dry_run, "Only show the plan");
  run->add_option("--jobs", options.jobs, "Jobs at a time; they share the cores")
      ->capture_default_str()
      ->check(anigen::whole_number(1, 1024));
  CLI::Option* only = run->add_option("--only", options.only, "Only this job, or the jobs of this step");
  run->add_flag("--together", options.together,
                "With --only: others may run the same job at the same time and share its work")
      ->needs(only);
  run->add_option("--emit", "slurm: write array jobs for a cluster instead of running")
      ->check(CLI::IsMember({"slurm"}))
      ->each([&options](const std::string&) { options.slurm = true; });
  CLI::App* status = app.add_subcommand("status", "What is done, running, failed and still to do");
  CLI::App* report = app.add_subcommand("report", "Write the report from what is done");
  CLI::App* clean = app.add_subcommand("clean", "Remove results that the file no longer asks for");
  for (CLI::App* command : {status, report, clean}) add_options(*command, options);
  clean->add_flag("--dry-run", options.dry_run, "Only list them");
  anigen::add_common_options(app, common, {}, {{"--seed", "takes seeds from the experiment's file"}});
  return anigen::run_command(app, common, argc, argv, [&] {
    using What = ExperimentCommand::What;
    options.what = status->parsed()   ? What::kStatus
                   : report->parsed() ? What::kReport
                   : clean->parsed()  ? What::kClean
                                      : What::kRun;
    options.threads = common.threads;
    options.place.device = common.device;
    std::fputs(anigen::experiment::run_experiment_command(options, common.json).c_str(), stdout);
  });
}
