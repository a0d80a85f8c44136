#include <string>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/train_arguments.h"
#include "anigen/apps/with_torch/programs.h"
#include "anigen/core/cores.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/train/distributed/local_ranks.h"
#include "anigen/train/train_command.h"

namespace anigen {
namespace {

train::TrainCommand command_of(const TrainArguments& arguments, const CommonOptions& common) {
  train::TrainCommand command;
  command.config = arguments.config;
  command.overrides = arguments.overrides;
  command.data_dir = arguments.data_dir;
  command.run.output = arguments.output;
  command.run.load = arguments.load;
  command.run.ckpt = arguments.ckpt;
  command.run.restart = arguments.restart;
  command.run.profile_steps = arguments.profile_steps;
  command.run.threads = thread_count();
  command.device = common.device;
  command.ranks.timeout = arguments.timeout;
  command.ranks.sent = arguments.communication == "bf16" ? torch::kBFloat16 : torch::kFloat32;
  for (const std::string& word : arguments.words)
    command.command_line += (command.command_line.empty() ? "" : " ") + word;
  if (common.seed_given) command.overrides.push_back("trainer.args.seed=" + std::to_string(common.seed));
  if (!arguments.warm_start.empty()) {
    command.overrides.push_back(arguments.warm_start == "none" ? std::string("trainer.args.warm_start=none")
                                                               : "trainer.args.pretrained_dir=" + arguments.warm_start);
  }
  return command;
}

}  // namespace

int run_train(const TrainArguments& arguments, const CommonOptions& common) {
  const train::LaunchEnvironment environment = train::read_launch_environment(arguments.rendezvous);
  if (!arguments.ranks_given && environment.launcher.empty() && !arguments.only_of_ranks.empty()) {
    throw InputError("", arguments.only_of_ranks.front(),
                     "is for several processes: there is neither --ranks nor a launcher");
  }
  if (arguments.ranks > 1 && environment.launcher.empty())
    return train::run_local_ranks({arguments.ranks, arguments.restarts, arguments.timeout}, arguments.words);
  if (arguments.ranks > 1 && arguments.ranks != environment.size) {
    throw InputError(
        "--ranks", std::to_string(arguments.ranks),
        environment.launcher + " has started " + std::to_string(environment.size) + "; leave the option out");
  }
  if (common.threads == 0 && environment.local_size > 1)
    set_thread_count(shared_thread_count(find_cores(), environment.local_size));
  train::TrainCommand command = command_of(arguments, common);
  command.environment = environment;
  train::train(command);
  return 0;
}

}  // namespace anigen
