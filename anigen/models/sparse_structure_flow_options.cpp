#include "anigen/models/sparse_structure_flow_options.h"

#include <algorithm>
#include <utility>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::models {
namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMaxFlowWidth = 16384;
constexpr std::int64_t kMaxFlowBlocks = 256;
constexpr std::int64_t kMaxFlowResolution = 128;
constexpr std::int64_t kMaxFlowTokens = 1 << 21;
constexpr std::int64_t kLoraRank = 8;

std::int64_t required_size(ConfigReader& reader, const std::string& key, std::int64_t highest) {
  reader.require(key);
  return reader.integer(key, 0, 1, highest);
}

void read_flow_sizes(ConfigReader& reader, SparseStructureFlowOptions& options) {
  options.resolution = required_size(reader, "resolution", kMaxFlowResolution);
  options.in_channels = required_size(reader, "in_channels", kMaxFlowWidth);
  options.in_channels_skl = required_size(reader, "in_channels_skl", kMaxFlowWidth);
  options.out_channels = required_size(reader, "out_channels", kMaxFlowWidth);
  options.out_channels_skl = required_size(reader, "out_channels_skl", kMaxFlowWidth);
  options.model_channels = required_size(reader, "model_channels", kMaxFlowWidth);
  options.model_channels_skl = required_size(reader, "model_channels_skl", kMaxFlowWidth);
  options.cond_channels = required_size(reader, "cond_channels", kMaxFlowWidth);
  options.num_blocks = required_size(reader, "num_blocks", kMaxFlowBlocks);
  const Json* heads = reader.raw("num_heads");  // null means the same as leaving it out
  if (heads != nullptr && !heads->is_null()) options.num_heads = reader.integer("num_heads", 0, 1, kMaxFlowWidth);
  options.num_head_channels = reader.integer("num_head_channels", options.num_head_channels, 1, kMaxFlowWidth);
  options.mlp_ratio = reader.number("mlp_ratio", options.mlp_ratio, 0.0, 64.0);
  options.patch_size = reader.integer("patch_size", options.patch_size, 1, kMaxFlowResolution);
}

void read_flow_switches(ConfigReader& reader, SparseStructureFlowOptions& options) {
  options.pe_mode = reader.choice("pe_mode", options.pe_mode, {"ape", "rope"});
  const std::pair<const char*, bool*> switches[] = {{"use_fp16", &options.use_fp16},
                                                    {"use_checkpoint", &options.use_checkpoint},
                                                    {"share_mod", &options.share_mod},
                                                    {"qk_rms_norm", &options.qk_rms_norm},
                                                    {"qk_rms_norm_cross", &options.qk_rms_norm_cross},
                                                    {"use_pretrain_branch", &options.use_pretrain_branch},
                                                    {"freeze_pretrain_branch", &options.freeze_pretrain_branch},
                                                    {"use_lora_ss", &options.use_lora_ss},
                                                    {"adapter_ss_to_skl", &options.adapter_ss_to_skl},
                                                    {"adapter_skl_to_ss", &options.adapter_skl_to_ss},
                                                    {"predict_x0", &options.predict_x0},
                                                    {"predict_x0_skl", &options.predict_x0_skl},
                                                    {"z_is_global", &options.z_is_global},
                                                    {"z_skl_is_global", &options.z_skl_is_global},
                                                    {"skl_cross_from_ss", &options.skl_cross_from_ss}};
  for (const auto& [key, value] : switches) *value = reader.boolean(key, *value);
}

void check_flow_option(bool valid, const std::string& file, const std::string& place, const std::string& problem) {
  if (!valid) throw InputError(file, place, problem);
}

}  // namespace

SparseStructureFlowOptions SparseStructureFlowOptions::from_json(const Json& json, const std::string& file,
                                                                 const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  SparseStructureFlowOptions options;
  read_flow_sizes(reader, options);
  read_flow_switches(reader, options);
  options.lora_lr_rate_ss = reader.number("lora_lr_rate_ss", options.lora_lr_rate_ss);
  options.modules_to_freeze = reader.texts("modules_to_freeze", options.modules_to_freeze);
  options.t_eps = reader.number("t_eps", options.t_eps, 0.0);
  options.t_scale = reader.number("t_scale", options.t_scale, 0.0);
  options.global_token_num = reader.integer("global_token_num", options.global_token_num, 1, kMaxFlowTokens);
  options.global_token_num_skl =
      reader.integer("global_token_num_skl", options.global_token_num_skl, 1, kMaxFlowTokens);
  options.cross_adapter_every = reader.integer("cross_adapter_every", options.cross_adapter_every, 1, kMaxFlowBlocks);
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json SparseStructureFlowOptions::to_json() const {
  Json json;
  json["resolution"] = resolution;
  json["in_channels"] = in_channels;
  json["in_channels_skl"] = in_channels_skl;
  json["out_channels"] = out_channels;
  json["out_channels_skl"] = out_channels_skl;
  json["model_channels"] = model_channels;
  json["model_channels_skl"] = model_channels_skl;
  json["cond_channels"] = cond_channels;
  json["num_blocks"] = num_blocks;
  if (num_heads > 0) json["num_heads"] = num_heads;
  json["num_head_channels"] = num_head_channels;
  json["mlp_ratio"] = mlp_ratio;
  json["patch_size"] = patch_size;
  json["pe_mode"] = pe_mode;
  json["use_fp16"] = use_fp16;
  json["use_checkpoint"] = use_checkpoint;
  json["share_mod"] = share_mod;
  json["qk_rms_norm"] = qk_rms_norm;
  json["qk_rms_norm_cross"] = qk_rms_norm_cross;
  json["use_pretrain_branch"] = use_pretrain_branch;
  json["freeze_pretrain_branch"] = freeze_pretrain_branch;
  json["use_lora_ss"] = use_lora_ss;
  json["lora_lr_rate_ss"] = lora_lr_rate_ss;
  json["modules_to_freeze"] = modules_to_freeze;
  json["adapter_ss_to_skl"] = adapter_ss_to_skl;
  json["adapter_skl_to_ss"] = adapter_skl_to_ss;
  json["predict_x0"] = predict_x0;
  json["predict_x0_skl"] = predict_x0_skl;
  json["t_eps"] = t_eps;
  json["t_scale"] = t_scale;
  json["z_is_global"] = z_is_global;
  json["z_skl_is_global"] = z_skl_is_global;
  json["global_token_num"] = global_token_num;
  json["global_token_num_skl"] = global_token_num_skl;
  json["cross_adapter_every"] = cross_adapter_every;
  json["skl_cross_from_ss"] = skl_cross_from_ss;
  return json;
}

void SparseStructureFlowOptions::validate(const std::string& file, const std::string& pointer) const {
  if (pe_mode != "ape") throw NotSupportedError(file, pointer + "/pe_mode", "pe_mode '" + pe_mode + "'; use 'ape'");
  check_flow_option(resolution > 0 && in_channels > 0 && in_channels_skl > 0 && out_channels > 0 &&
                        out_channels_skl > 0 && model_channels > 0 && model_channels_skl > 0 && cond_channels > 0 &&
                        num_blocks > 0,
                    file, pointer, "every size must be positive");
  check_flow_option(
      patch_size > 0 && resolution % patch_size == 0, file, pointer + "/patch_size",
      "patches of " + std::to_string(patch_size) + " do not divide a resolution of " + std::to_string(resolution));
  const std::int64_t count = heads();
  check_flow_option(count > 0, file, pointer + "/num_head_channels", "leaves no head");
  const std::pair<const char*, std::int64_t> widths[] = {{"/model_channels", model_channels},
                                                         {"/model_channels_skl", model_channels_skl}};
  for (const auto& [key, channels] : widths) {
    check_flow_option(channels % count == 0, file, pointer + key,
                      std::to_string(count) + " heads do not divide " + std::to_string(channels) + " channels");
    check_flow_option(static_cast<double>(channels) * mlp_ratio >= 1.0, file, pointer + "/mlp_ratio",
                      "leaves no hidden channel");
  }
  check_flow_option(!predict_x0 || (in_channels == out_channels), file, pointer + "/predict_x0",
                    "needs as many output as input channels");
  check_flow_option(!predict_x0_skl || (in_channels_skl == out_channels_skl), file, pointer + "/predict_x0_skl",
                    "needs as many output as input channels");
  check_flow_option(t_eps > 0.0 && t_scale > 0.0, file, pointer + "/t_eps", "t_eps and t_scale must be positive");
}

std::int64_t SparseStructureFlowOptions::tokens() const {
  const std::int64_t side = resolution / patch_size;
  return z_is_global ? global_token_num : side * side * side;
}

std::int64_t SparseStructureFlowOptions::tokens_skl() const {
  const std::int64_t side = resolution / patch_size;
  return z_skl_is_global ? global_token_num_skl : side * side * side;
}

bool SparseStructureFlowOptions::has_cross_adapter(std::int64_t block) const {
  if (!exchanges_by_attention()) return false;
  return num_blocks < cross_adapter_every ? block + 1 == num_blocks : (block + 1) % cross_adapter_every == 0;
}

std::int64_t SparseStructureFlowOptions::lora_rank_self(std::int64_t block) const {
  const std::int64_t first = std::max<std::int64_t>(1, num_blocks / 3 * 2);
  return use_lora_ss && block >= first ? kLoraRank : 0;
}

std::int64_t SparseStructureFlowOptions::lora_rank_cross(std::int64_t block) const {
  const std::int64_t third = std::max<std::int64_t>(1, num_blocks / 3);
  return use_lora_ss ? kLoraRank * (1 + block / third) : 0;
}

}  // namespace anigen::models
