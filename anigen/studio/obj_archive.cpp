#include "anigen/studio/obj_archive.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/core/table.h"
#include "anigen/io/obj.h"
#include "anigen/io/usd/package.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

/// A folder beside a file, for what it is made of.
class BesideFolder {
 public:
  explicit BesideFolder(const fs::path& file) : path_(file.string() + ".tmp-" + process_number()) {
    fs::create_directories(path_);
  }
  ~BesideFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  BesideFolder(const BesideFolder&) = delete;
  BesideFolder& operator=(const BesideFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::string material_name(std::int32_t material) { return material < 0 ? "plain" : "m" + std::to_string(material); }

std::string texture_name(const Asset& asset, std::size_t image) {
  return "texture_" + std::to_string(image) + (asset.images[image].mime_type == "image/jpeg" ? ".jpg" : ".png");
}

std::string mtl_text(const Asset& asset) {
  std::string text = "# AniGen in C++\nnewmtl plain\nKd 1 1 1\n";
  for (std::size_t m = 0; m < asset.materials.size(); ++m) {
    const Material& material = asset.materials[m];
    text += "newmtl " + material_name(static_cast<std::int32_t>(m)) + "\nKd";
    for (int channel = 0; channel < 3; ++channel) text += " " + significant(material.base_color[channel], 6);
    text += "\nd " + significant(material.base_color.w(), 6) + "\n";
    if (material.image >= 0) text += "map_Kd " + texture_name(asset, at(material.image)) + "\n";
  }
  return text;
}

/// The text of an OBJ with the materials of its faces, which stand in the order of the mesh.
std::string painted(std::string_view obj, const std::vector<std::int32_t>& materials) {
  std::string text = "mtllib model.mtl\n";
  std::string used;
  for (std::size_t begin = 0, face = 0; begin < obj.size();) {
    const std::size_t end = std::min(obj.find('\n', begin), obj.size() - 1) + 1;
    const std::string_view line = obj.substr(begin, end - begin);
    begin = end;
    if (line.substr(0, 2) == "f ") {
      const std::string name = material_name(materials.empty() ? -1 : materials[face]);
      ++face;
      if (name != used) text += "usemtl " + (used = name) + "\n";
    }
    text += line;
  }
  return text;
}

}  // namespace

void write_obj_archive(const Asset& asset, const fs::path& file) {
  const BesideFolder folder(file);
  io::write_obj_rig(folder.path() / "model.obj", asset);
  std::vector<io::usd_export::PackageFile> files{
      {"model.obj", painted(read_file(folder.path() / "model.obj"), asset.mesh.face_materials)},
      {"model.mtl", mtl_text(asset)},
      {"model.rig.json", read_file(folder.path() / "model.rig.json")}};
  for (std::size_t i = 0; i < asset.images.size(); ++i)
    files.push_back({texture_name(asset, i), {asset.images[i].bytes.begin(), asset.images[i].bytes.end()}});
  write_file_atomically(file, io::usd_export::package_bytes(files, file.string()));
}

}  // namespace anigen::studio
