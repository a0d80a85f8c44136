#include "anigen/models/structured_latent_flow_options.h"

#include <utility>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::models {
namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostSlatFlowChannels = 16384;
constexpr std::int64_t kMostSlatFlowBlocks = 256;
constexpr std::int64_t kMostSlatFlowResolution = 1 << 20;
constexpr std::int64_t kMostSlatFlowJoints = 1 << 16;
constexpr std::int64_t kMostSlatFlowBands = 24;
constexpr std::int64_t kMostSlatFlowLevels = 8;

using StreamSizes = StructuredLatentFlowStreamOptions;

struct SlatFlowStreamKey {
  const char* suffix;
  StreamSizes StructuredLatentFlowOptions::*stream;
};
constexpr SlatFlowStreamKey kSlatFlowStreams[] = {{"", &StructuredLatentFlowOptions::geometry},
                                                  {"_vert_skin", &StructuredLatentFlowOptions::skin},
                                                  {"_skl", &StructuredLatentFlowOptions::skeleton}};

struct SlatFlowSwitch {
  const char* key;
  bool StructuredLatentFlowOptions::*value;
};
constexpr SlatFlowSwitch kSlatFlowSwitches[] = {
    {"use_fp16", &StructuredLatentFlowOptions::use_fp16},
    {"use_checkpoint", &StructuredLatentFlowOptions::use_checkpoint},
    {"use_skip_connection", &StructuredLatentFlowOptions::use_skip_connection},
    {"share_mod", &StructuredLatentFlowOptions::share_mod},
    {"qk_rms_norm", &StructuredLatentFlowOptions::qk_rms_norm},
    {"qk_rms_norm_cross", &StructuredLatentFlowOptions::qk_rms_norm_cross},
    {"use_pretrain_branch", &StructuredLatentFlowOptions::use_pretrain_branch},
    {"freeze_pretrain_branch", &StructuredLatentFlowOptions::freeze_pretrain_branch},
    {"predict_x0", &StructuredLatentFlowOptions::predict_x0},
    {"use_joint_num_cond", &StructuredLatentFlowOptions::use_joint_num_cond}};

std::int64_t needed_size(ConfigReader& reader, const std::string& key, std::int64_t highest) {
  reader.require(key);
  return reader.integer(key, 0, 1, highest);
}

bool is_null_or_absent(ConfigReader& reader, const std::string& key) {
  const Json* value = reader.raw(key);
  return value == nullptr || value->is_null();
}

void read_flow_stream(ConfigReader& reader, const std::string& suffix, StreamSizes& stream) {
  stream.in_channels = needed_size(reader, "in_channels" + suffix, kMostSlatFlowChannels);
  stream.out_channels = needed_size(reader, "out_channels" + suffix, kMostSlatFlowChannels);
  stream.model_channels = needed_size(reader, "model_channels" + suffix, kMostSlatFlowChannels);
  const std::string heads = "num_heads" + suffix, widths = "io_block_channels" + suffix;
  if (!is_null_or_absent(reader, heads)) stream.num_heads = reader.integer(heads, 0, 1, kMostSlatFlowChannels);
  stream.num_head_channels =
      reader.integer("num_head_channels" + suffix, stream.num_head_channels, 1, kMostSlatFlowChannels);
  stream.num_io_res_blocks =
      reader.integer("num_io_res_blocks" + suffix, stream.num_io_res_blocks, 1, kMostSlatFlowBlocks);
  if (!is_null_or_absent(reader, widths)) stream.io_block_channels = reader.integers(widths, {});
}

void write_flow_stream(Json& json, const std::string& suffix, const StreamSizes& stream) {
  json["in_channels" + suffix] = stream.in_channels;
  json["out_channels" + suffix] = stream.out_channels;
  json["model_channels" + suffix] = stream.model_channels;
  json["num_heads" + suffix] = stream.num_heads > 0 ? Json(stream.num_heads) : Json(nullptr);
  json["num_head_channels" + suffix] = stream.num_head_channels;
  json["num_io_res_blocks" + suffix] = stream.num_io_res_blocks;
  json["io_block_channels" + suffix] = stream.io_block_channels ? Json(*stream.io_block_channels) : Json(nullptr);
}

// Where the options stand, for messages.
struct SlatFlowPlace {
  const std::string &file, &pointer;

  void check(bool valid, const std::string& key, const std::string& problem) const {
    if (!valid) throw InputError(file, key.empty() ? pointer : pointer + "/" + key, problem);
  }
};

void check_flow_stream(const SlatFlowPlace& at, const std::string& suffix, const StreamSizes& stream,
                       const StructuredLatentFlowOptions& options) {
  at.check(stream.in_channels > 0 && stream.out_channels > 0 && stream.model_channels > 0, "model_channels" + suffix,
           "every width must be positive");
  const std::int64_t heads = stream.heads();
  at.check(heads > 0, "num_head_channels" + suffix, "leaves no head");
  at.check(stream.model_channels % heads == 0, "model_channels" + suffix,
           std::to_string(heads) + " heads do not divide " + std::to_string(stream.model_channels) + " channels");
  at.check(static_cast<double>(stream.model_channels) * options.mlp_ratio >= 1.0, "mlp_ratio",
           "leaves no hidden channel");
  if (!stream.io_block_channels) return;
  const std::string key = "io_block_channels" + suffix;
  for (const std::int64_t width : *stream.io_block_channels) {
    at.check(width > 0 && width <= kMostSlatFlowChannels, key, "widths must be positive and sensible");
  }
  at.check(stream.num_io_res_blocks > 0, "num_io_res_blocks" + suffix, "must be at least 1");
  at.check(stream.levels() <= kMostSlatFlowLevels && options.patch_size == std::int64_t{1} << stream.levels(), key,
           std::to_string(stream.levels()) + " widths halve the resolution as often, which is not a patch_size of " +
               std::to_string(options.patch_size));
}

}  // namespace

StructuredLatentFlowOptions StructuredLatentFlowOptions::read(ConfigReader& reader) {
  StructuredLatentFlowOptions options;
  options.resolution = needed_size(reader, "resolution", kMostSlatFlowResolution);
  for (const auto& [suffix, stream] : kSlatFlowStreams) read_flow_stream(reader, suffix, options.*stream);
  options.cond_channels = needed_size(reader, "cond_channels", kMostSlatFlowChannels);
  options.num_blocks = needed_size(reader, "num_blocks", kMostSlatFlowBlocks);
  options.mlp_ratio = reader.number("mlp_ratio", options.mlp_ratio, 0.0, 64.0);
  options.patch_size = reader.integer("patch_size", options.patch_size, 1, std::int64_t{1} << kMostSlatFlowLevels);
  options.pe_mode = reader.choice("pe_mode", options.pe_mode, {"ape", "rope"});
  for (const auto& [key, value] : kSlatFlowSwitches) options.*value = reader.boolean(key, options.*value);
  options.modules_to_freeze = reader.texts("modules_to_freeze", options.modules_to_freeze);
  options.t_eps = reader.number("t_eps", options.t_eps, 0.0);
  options.t_scale = reader.number("t_scale", options.t_scale, 0.0);
  options.joint_num_max = reader.integer("joint_num_max", options.joint_num_max, 1, kMostSlatFlowJoints);
  options.joint_num_fourier_bands =
      reader.integer("joint_num_fourier_bands", options.joint_num_fourier_bands, 1, kMostSlatFlowBands);
  options.validate(reader.file(), reader.pointer_to(""));
  return options;
}

StructuredLatentFlowOptions StructuredLatentFlowOptions::from_json(const Json& json, const std::string& file,
                                                                   const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  StructuredLatentFlowOptions options = read(reader);
  reader.finish();
  return options;
}

Json StructuredLatentFlowOptions::to_json() const {
  Json json;
  json["resolution"] = resolution;
  for (const auto& [suffix, stream] : kSlatFlowStreams) write_flow_stream(json, suffix, this->*stream);
  json["cond_channels"] = cond_channels;
  json["num_blocks"] = num_blocks;
  json["mlp_ratio"] = mlp_ratio;
  json["patch_size"] = patch_size;
  json["pe_mode"] = pe_mode;
  for (const auto& [key, value] : kSlatFlowSwitches) json[key] = this->*value;
  json["modules_to_freeze"] = modules_to_freeze;
  json["t_eps"] = t_eps;
  json["t_scale"] = t_scale;
  json["joint_num_max"] = joint_num_max;
  json["joint_num_fourier_bands"] = joint_num_fourier_bands;
  return json;
}

void StructuredLatentFlowOptions::validate(const std::string& file, const std::string& pointer) const {
  if (pe_mode != "ape") throw NotSupportedError(file, pointer + "/pe_mode", "pe_mode '" + pe_mode + "'; use 'ape'");
  const SlatFlowPlace at{file, pointer};
  at.check(resolution > 0 && cond_channels > 0 && num_blocks > 0, "", "every size must be positive");
  for (const auto& [suffix, stream] : kSlatFlowStreams) check_flow_stream(at, suffix, this->*stream, *this);
  at.check(geometry.levels() == skin.levels(), "io_block_channels_vert_skin",
           "the skin must have as many widths as the geometry, whose voxels it shares");
  for (const auto& [suffix, stream] : kSlatFlowStreams) {
    const StreamSizes& sizes = this->*stream;
    const bool concerned = predict_x0 && &sizes != &geometry;
    at.check(!concerned || sizes.in_channels == sizes.out_channels, std::string("out_channels") + suffix,
             "predict_x0 needs as many output as input channels");
  }
  at.check(t_eps > 0.0 && t_scale > 0.0, "t_eps", "t_eps and t_scale must be positive");
  at.check(joint_num_max > 0 && joint_num_fourier_bands > 0, "joint_num_max",
           "joint_num_max and joint_num_fourier_bands must be positive");
}

}  // namespace anigen::models
