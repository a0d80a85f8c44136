#include "anigen/models/dinov2_options.h"

#include <array>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::models {
namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostDinoChannels = 16384;
constexpr std::int64_t kMostDinoBlocks = 256;
constexpr std::int64_t kMostDinoSide = 16384;

struct Size {
  const char* letter;
  std::int64_t embed_dim, depth, num_heads;
  const char* ffn_layer;
};

constexpr std::array<Size, 4> kSizes = {{{"s", 384, 12, 6, "mlp"},
                                         {"b", 768, 12, 12, "mlp"},
                                         {"l", 1024, 24, 16, "mlp"},
                                         {"g", 1536, 40, 24, "swiglufused"}}};
constexpr std::int64_t kRegisters = 4;

std::string name_of(const Size& size, bool registers) {
  return std::string("dinov2_vit") + size.letter + "14" + (registers ? "_reg" : "");
}

void require_valid(bool valid, const std::string& file, const std::string& place, const std::string& problem) {
  if (!valid) throw InputError(file, place, problem);
}

}  // namespace

std::vector<std::string> Dinov2Options::names() {
  std::vector<std::string> all;
  for (const bool registers : {false, true}) {
    for (const Size& size : kSizes) all.push_back(name_of(size, registers));
  }
  return all;
}

std::string Dinov2Options::published_file_stem(const std::string& name) {
  const bool registers = name.size() > 4 && name.compare(name.size() - 4, 4, "_reg") == 0;
  return name + (registers ? "4" : "") + "_pretrain";
}

Dinov2Options Dinov2Options::named(const std::string& name) {
  for (const bool registers : {false, true}) {
    for (const Size& size : kSizes) {
      if (name_of(size, registers) != name) continue;
      Dinov2Options options;
      options.embed_dim = size.embed_dim;
      options.depth = size.depth;
      options.num_heads = size.num_heads;
      options.ffn_layer = size.ffn_layer;
      options.num_register_tokens = registers ? kRegisters : 0;
      options.interpolate_antialias = registers;
      options.interpolate_offset = registers ? 0.0 : 0.1;
      return options;
    }
  }
  const std::string nearest = nearest_word(name, names());
  throw InputError("", "",
                   "there is no DINOv2 model '" + name + "'; " +
                       (nearest.empty() ? "known are dinov2_vit{s,b,l,g}14 and the same with _reg"
                                        : "did you mean '" + nearest + "'?"));
}

Dinov2Options Dinov2Options::from_json(const Json& json, const std::string& file, const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  Dinov2Options options;
  options.img_size = reader.integer("img_size", options.img_size, 1, kMostDinoSide);
  options.patch_size = reader.integer("patch_size", options.patch_size, 1, kMostDinoSide);
  options.embed_dim = reader.integer("embed_dim", options.embed_dim, 1, kMostDinoChannels);
  options.depth = reader.integer("depth", options.depth, 0, kMostDinoBlocks);
  options.num_heads = reader.integer("num_heads", options.num_heads, 1, kMostDinoChannels);
  options.mlp_ratio = reader.number("mlp_ratio", options.mlp_ratio, 0.0, 64.0);
  options.ffn_layer = reader.choice("ffn_layer", options.ffn_layer, {"mlp", "swiglu", "swiglufused"});
  options.num_register_tokens =
      reader.integer("num_register_tokens", options.num_register_tokens, 0, kMostDinoChannels);
  options.interpolate_antialias = reader.boolean("interpolate_antialias", options.interpolate_antialias);
  options.interpolate_offset = reader.number("interpolate_offset", options.interpolate_offset, 0.0, 1.0);
  reader.number("init_values", 1.0);
  if (reader.integer("block_chunks", 0) != 0) {
    throw NotSupportedError(file, reader.pointer_to("block_chunks"),
                            "blocks in chunks, which no published weights use");
  }
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json Dinov2Options::to_json() const {
  Json json;
  json["img_size"] = img_size;
  json["patch_size"] = patch_size;
  json["embed_dim"] = embed_dim;
  json["depth"] = depth;
  json["num_heads"] = num_heads;
  json["mlp_ratio"] = mlp_ratio;
  json["ffn_layer"] = ffn_layer;
  json["num_register_tokens"] = num_register_tokens;
  json["interpolate_antialias"] = interpolate_antialias;
  json["interpolate_offset"] = interpolate_offset;
  return json;
}

void Dinov2Options::validate(const std::string& file, const std::string& pointer) const {
  require_valid(patch_size > 0 && img_size >= patch_size, file, pointer + "/img_size",
                std::to_string(img_size) + " pixels hold no patch of " + std::to_string(patch_size));
  require_valid(num_heads > 0 && embed_dim % num_heads == 0, file, pointer + "/num_heads",
                std::to_string(num_heads) + " heads do not divide " + std::to_string(embed_dim) + " channels");
  require_valid(ffn_hidden() >= 1, file, pointer + "/mlp_ratio", "leaves no hidden channel");
}

std::int64_t Dinov2Options::ffn_hidden() const {
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(embed_dim) * mlp_ratio);
  if (!swiglu()) return hidden;
  return (hidden * 2 / 3 + 7) / 8 * 8;
}

}  // namespace anigen::models
