#include "anigen/train/train_command.h"

#include <ATen/Context.h>

#include <ctime>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/config_file.h"
#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/nn/computing.h"
#include "anigen/train/precision.h"
#include "anigen/train/stages.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

Json resolved_config(const TrainCommand& command, std::string& file) {
  const fs::path earlier = command.run.output / "config.json";
  std::error_code error;
  if (command.config.empty() && !fs::exists(earlier, error)) {
    throw InputError(earlier.string(), "", "there is no run to resume here; give --config");
  }
  const fs::path source = command.config.empty() ? earlier : command.config;
  file = source.string();
  Json config = load_config(source);
  apply_overrides(config, command.overrides);
  if (!command.data_dir.empty()) config["dataset"]["args"]["data_dir"] = command.data_dir;
  if (config.is_object() && config.contains("dataset")) loaders::write_out_statistics(config["dataset"], file);
  return config;
}

// A resumed run may be continued with changed settings, but not without saying so.
void report_changes(const fs::path& earlier, const Json& config) {
  std::error_code error;
  if (!fs::exists(earlier, error)) return;
  const Json before = read_json(earlier);
  for (const Json& change : Json::diff(before, config)) {
    log::warn("config differs from the one this run began with: {} {}", change.at("op").get<std::string>(),
              change.at("path").get<std::string>());
  }
}

void append_command(const fs::path& file, const std::string& line) {
  std::error_code error;
  std::string text = fs::exists(file, error) ? read_file(file) : std::string();
  const std::time_t now = std::time(nullptr);
  char stamp[40];
  std::strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  write_file_atomically(file, text + stamp + " " + line + "\n");
}

}  // namespace

torch::Device parse_device(const std::string& name) {
  const bool cuda = name == "cuda" || name.rfind("cuda:", 0) == 0;
  const std::string index = cuda && name.size() > 5 ? name.substr(5) : "0";
  const bool digits = !index.empty() && index.size() < 4 && index.find_first_not_of("0123456789") == std::string::npos;
  if ((name != "cpu" && !cuda) || !digits || name == "cuda:") {
    throw InputError("--device", name, "expected cpu, cuda or cuda:N");
  }
  if (!cuda) return torch::kCPU;
  const auto wanted = static_cast<std::size_t>(std::stoul(index));
  if (wanted >= torch::cuda::device_count()) throw InputError("--device", name, "this LibTorch sees no such device");
  return torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(wanted));
}

void make_deterministic(torch::Device device) {
  if (!device.is_cuda()) return;
  at::globalContext().setDeterministicCuDNN(true);
  at::globalContext().setBenchmarkCuDNN(false);
}

void train(const TrainCommand& command) {
  nn::set_up_computing(command.run.threads);
  std::string file;
  const Json config = resolved_config(command, file);
  const torch::Device device = parse_device(command.device);
  ConfigReader top(config, file);
  for (const char* part : {"models", "dataset", "trainer"}) top.require(part);
  ConfigReader trainer = top.object("trainer");
  trainer.require("name");
  const std::string name = trainer.text("name", "");
  ConfigReader args = trainer.object("args");
  TrainerOptions options = TrainerOptions::read(args);
  top.raw("models");
  top.raw("dataset");
  top.finish();
  trainer.finish();

  make_deterministic(device);
  torch::manual_seed(options.seed);
  const Precision precision = choose_precision(options, device, file);
  options.update.loss_scaling = precision.loss_scaling;
  options.compute_dtype = precision.compute;
  if (!precision.note.empty()) log::info("{}", precision.note);
  // Everything is read and checked before the run folder is touched.
  const std::unique_ptr<Stage> stage = make_stage(name, config, file, args, options, device);
  args.finish();
  if (!stage->supports(precision.compute)) {
    throw NotSupportedError(file, "/trainer/args/precision",
                            "precision " + options.precision + " with trainer " + name.substr(0, 80));
  }

  std::error_code error;
  fs::create_directories(command.run.output, error);
  if (error) throw Error(command.run.output.string() + ": cannot create folder: " + error.message());
  log::also_to_file(command.run.output / "log.txt");
  report_changes(command.run.output / "config.json", config);
  write_config(command.run.output / "config.json", config);
  append_command(command.run.output / "command.txt", command.command_line);
  Trainer loop(*stage, options, command.run);
  log::info("{} trainable parameters, {} threads, {} replicas", loop.parameters().master().numel(), command.run.threads,
            options.replicas);
  loop.run();
  log::info("finished at step {}; results are in {}", loop.step(), command.run.output.string());
}

}  // namespace anigen::train
