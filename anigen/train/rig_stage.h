#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/train/rig_scores.h"
#include "anigen/train/stage.h"
#include "anigen/train/trainer_options.h"

namespace anigen::train {

/// A stage of a model that rigs given meshes: its held-out assets are scored one by one. Modules draw from LibTorch's
/// default generator, which every step seeds, so there can be no replicas.
class RigStage : public Stage {
 public:
  Values evaluate() override;                                 ///< means of the scores
  void sample(const std::filesystem::path& folder) override;  ///< scores.csv: the metrics of each held-out asset
  /// @throws NotSupportedError
  std::unique_ptr<Stage> replica() const override;

 protected:
  /// @param family whose models these are, for messages @param held_out assets @param most of them to look at; 0: all
  RigStage(std::string family, std::size_t held_out, std::int64_t most);
  /// Of the first so many held-out assets. @post the model is in training mode
  virtual RigScores scores(std::size_t assets) = 0;

 private:
  std::string family_;
  std::size_t looked_at_;
};

/// The only model of a config, and where its arguments stand.
struct OnlyModel {
  std::string name;
  const Json* args;
  std::string pointer;  ///< JSON pointer of the arguments
};

/// @param top the config @throws InputError unless there is exactly one model, of this class, with arguments
OnlyModel read_only_model(ConfigReader& top, const std::string& class_name);

/// @throws NotSupportedError for several replicas @param family whose models these are
void require_one_replica(const TrainerOptions& trainer, const std::string& file, const std::string& family);

}  // namespace anigen::train
