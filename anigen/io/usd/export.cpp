#include "anigen/io/usd/export.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/version.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/linear_keys.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::io::usd_export {

Stage stage_of(const Asset& asset, const std::string& folder, const std::string& file) {
  const bool has_skeleton = asset.skeleton.size() > 0;
  const std::string root = Identifiers().make(asset.name, "Asset");
  const double rate = frame_rate(asset.animations);
  double last = 0.0;
  for (const Animation& animation : asset.animations) last = std::max(last, animation.duration());
  Stage stage;
  Lines lines;
  lines.add("#usda 1.0");
  lines.add("(");
  lines.add("    defaultPrim = \"" + root + "\"");
  lines.add("    doc = " + string_text(std::string("AniGen in C++ ") + kVersion));
  if (!asset.animations.empty()) {
    lines.add("    endTimeCode = " + number_text(last * rate));
    lines.add("    framesPerSecond = " + number_text(rate));
  }
  lines.add("    metersPerUnit = 1");
  if (!asset.animations.empty()) {
    lines.add("    startTimeCode = 0");
    lines.add("    timeCodesPerSecond = " + number_text(rate));
  }
  lines.add("    upAxis = \"Y\"");
  lines.add(")");
  lines.add("");
  lines.open_behind(std::string("def ") + (has_skeleton ? "SkelRoot" : "Xform") + " \"" + root + "\"", '(');
  lines.add_name(asset.name);
  lines.add("kind = \"component\"");
  lines.close(')');
  lines.open("");
  if (!asset.mesh.vertices.empty()) add_mesh(asset, "/" + root, folder, file, lines, stage.textures);
  if (has_skeleton) add_skeleton(asset, "/" + root, lines);
  lines.close();
  stage.text = lines.text();
  return stage;
}

}  // namespace anigen::io::usd_export

namespace anigen::io {

void write_usd(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options) {
  const std::string file = path.string();
  const bool packed = has_extension(path, {".usdz"});
  if (!packed && !has_extension(path, {".usda"}))
    throw InputError(file, "", "a USD file must be called .usda or .usdz");
  const std::string folder = packed ? "textures" : file_stem(path.stem().string()) + "_textures";
  Asset turned = file_asset(file, asset, options);
  remove_constant_scales(turned);
  usd_export::Stage stage = usd_export::stage_of(turned, folder, file);
  if (!packed) {
    for (const usd_export::PackageFile& texture : stage.textures)
      write_file_atomically(path.parent_path() / folder / texture.name, texture.bytes);
    return write_file_atomically(path, stage.text);
  }
  std::vector<usd_export::PackageFile> files;
  files.push_back({usd_export::Identifiers().make(path.stem().string(), "asset") + ".usda", std::move(stage.text)});
  for (usd_export::PackageFile& texture : stage.textures)
    files.push_back({folder + "/" + texture.name, std::move(texture.bytes)});
  write_file_atomically(path, usd_export::package_bytes(files, file));
}

}  // namespace anigen::io
