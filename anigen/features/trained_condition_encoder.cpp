#include "anigen/features/trained_condition_encoder.h"

#include <optional>

#include "anigen/core/config_reader.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"

namespace anigen::features {

std::unique_ptr<ConditionEncoder> trained_condition_encoder(const std::filesystem::path& run,
                                                            const models::RunModel& flow, std::int64_t image_size,
                                                            std::int64_t channels, torch::Device device) {
  ConfigReader top(flow.run, flow.config.string());
  ConfigReader trainer_args = top.object("trainer").object("args");
  auto encoder = make_condition_encoder(trainer_args, image_size, channels, device);
  const std::optional<nn::NamedModel> trained = encoder->trained();
  if (!trained) return encoder;
  const std::filesystem::path weights = models::newest_checkpoint(run, trained->name);
  models::load_state_dict(*trained->module, io::read_state_dict(weights), models::LoadMode::kStrict, weights.string());
  trained->module->eval();
  return encoder;
}

}  // namespace anigen::features
