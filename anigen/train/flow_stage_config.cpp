#include "anigen/train/flow_stage_config.h"

namespace anigen::train {

std::optional<models::RunModel> samples_decoder(const std::string& path, const std::string& ckpt,
                                                const std::string& class_name, const std::string& key,
                                                const TrainerOptions& trainer) {
  if (trainer.i_sample <= 0) return std::nullopt;
  if (path.empty()) {
    log::info("dataset.args.{} names no run: no samples will be drawn", key);
    return std::nullopt;
  }
  models::RunModel found = models::find_run_model(path, class_name, ckpt);
  log::info("samples are decoded by {}", found.checkpoint.string());
  return found;
}

}  // namespace anigen::train
