#include "anigen/train/rig_stage.h"

#include <algorithm>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

namespace anigen::train {
namespace {

NotSupportedError no_replicas(const std::string& file, const std::string& family) {
  return {file, "/trainer/args/replicas", "several replicas of " + family + "'s models"};
}

}  // namespace

RigStage::RigStage(std::string family, std::size_t held_out, std::int64_t most)
    : family_(std::move(family)),
      looked_at_(most == 0 ? held_out : std::min(static_cast<std::size_t>(most), held_out)) {}

Values RigStage::evaluate() { return looked_at_ > 0 ? scores(looked_at_).means() : Values(); }

void RigStage::sample(const std::filesystem::path& folder) {
  if (looked_at_ > 0) write_file_atomically(folder / "scores.csv", to_csv(scores(looked_at_).table()));
}

std::unique_ptr<Stage> RigStage::replica() const { throw no_replicas("", family_); }

OnlyModel read_only_model(ConfigReader& top, const std::string& class_name) {
  ConfigReader models = top.object("models");
  const Json& list = *top.raw("models");
  if (list.size() != 1) throw models.error("", "this trainer trains exactly one model");
  const std::string name = list.begin().key();
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", {class_name});
  model.require("args");
  const OnlyModel found{name, model.raw("args"), model.pointer_to("args")};
  model.finish();
  return found;
}

void require_one_replica(const TrainerOptions& trainer, const std::string& file, const std::string& family) {
  if (trainer.replicas != 1) throw no_replicas(file, family);
}

}  // namespace anigen::train
