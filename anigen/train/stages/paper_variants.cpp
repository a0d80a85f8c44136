#include "anigen/train/stages/paper_variants.h"

#include <algorithm>
#include <string>
#include <vector>

namespace anigen::train {

namespace {

constexpr double kPaperNoise = 0.75;

// An object inside an object; null where there is none.
Json* member_object(Json& object, const char* key) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_object()) return nullptr;
  return &object[key];
}

Json* model_args(Json& config, const char* model) {
  Json* models = member_object(config, "models");
  Json* found = models != nullptr ? member_object(*models, model) : nullptr;
  if (found == nullptr) return nullptr;
  if (!found->contains("args")) (*found)["args"] = Json::object();
  return member_object(*found, "args");
}

void fill(Json& args, const char* key, const Json& value) {
  if (!args.contains(key)) args[key] = value;
}

bool flag(const Json& args, const char* key, bool by_default) {
  if (!args.contains(key) || !args[key].is_boolean()) return by_default;
  return args[key].get<bool>();
}

// True when the layer that gives the shape's latents is trained. Defaults are those of the classes.
bool trains_shape_latents(const Json& encoder, const Json& trainer) {
  if (trainer.value("warm_start", Json("published")) == "none") return true;
  if (!flag(encoder, "use_pretrain_branch", true) || !flag(encoder, "freeze_pretrain_branch", true)) return true;
  if (!encoder.contains("modules_to_freeze") || !encoder["modules_to_freeze"].is_array()) return false;
  const Json& frozen = encoder["modules_to_freeze"];
  return std::none_of(frozen.begin(), frozen.end(),
                      [](const Json& name) { return name == "out_layer" || name == "all"; });
}

// Noise of one latent: its arguments end in `suffix`.
void fill_noise(Json& trainer, const std::string& suffix) {
  fill(trainer, ("latent_denoising" + suffix).c_str(), true);
  fill(trainer, ("latent_time_max" + suffix).c_str(), kPaperNoise);
  if (trainer.contains("max_steps") && trainer["max_steps"].is_number_integer())
    fill(trainer, ("latent_achive_max_step" + suffix).c_str(), trainer["max_steps"]);
}

void fill_sparse_structure(Json& config, Json& trainer) {
  Json *encoder = model_args(config, "encoder"), *decoder = model_args(config, "decoder");
  if (encoder == nullptr || decoder == nullptr) return;
  fill(*encoder, "normalize_norm", "l1");
  fill(*decoder, "normalize_norm", "l1");
  if (flag(*encoder, "latent_denoising_skl", true)) fill_noise(trainer, "_skl");
  if (!trains_shape_latents(*encoder, trainer)) return;
  fill(*encoder, "latent_denoising", true);
  if (!flag(*encoder, "latent_denoising", false)) return;
  fill(*encoder, "normalize_z", true);
  fill_noise(trainer, "");
}

void fill_structured_latent(Json& config, Json& trainer) {
  const Json* encoder = model_args(config, "encoder");
  if (encoder == nullptr) return;
  if (trains_shape_latents(*encoder, trainer)) fill(trainer, "geometry_latent", "dae");
  if (!flag(*encoder, "latent_denoising", true)) return;
  fill_noise(trainer, "");
  fill_noise(trainer, "_skl");
}

void fill_anymate(Json& config, Json& trainer) {
  Json* models = member_object(config, "models");
  if (models == nullptr) return;
  for (const auto& [name, unused] : models->items()) {
    Json* args = model_args(config, name.c_str());
    if (args == nullptr) continue;
    const Json decoder = args->value("decoder", Json());
    if (decoder != "attendjoints_con_token" && decoder != "attendjoints_con_combine") continue;
    fill(*args, "children", "columns");
    fill(trainer, "connectivity_loss", "bce");
  }
}

}  // namespace

void fill_in_paper_variants(Json& config) {
  Json* trainer = member_object(config, "trainer");
  Json* args = trainer != nullptr ? member_object(*trainer, "args") : nullptr;
  if (args == nullptr || args->value("compatibility", Json()) != "paper") return;
  const Json name = trainer->value("name", Json());
  if (name == "AniGenSparseStructureVaeTrainer") return fill_sparse_structure(config, *args);
  if (name == "AniGenSLatVaeSkeletonTrainer") return fill_structured_latent(config, *args);
  if (name == "AnymateTrainer") return fill_anymate(config, *args);
}

}  // namespace anigen::train
