#include "anigen/io/mtl.h"

#include <cstdint>
#include <map>
#include <string_view>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/obj.h"
#include "anigen/io/texture_files.h"

namespace anigen::io {

namespace {

constexpr std::uintmax_t kMostLibraryBytes = std::uintmax_t{16} << 20;

class MtlParser : TextLines {
 public:
  MtlParser(const std::string& text, const std::string& file) : TextLines(text, file) {}

  std::vector<MtlMaterial> parse() {
    while (next_line()) parse_line(left_.substr(0, left_.find('#')));
    return std::move(materials_);
  }

 private:
  void parse_line(std::string_view line) {
    const std::string_view keyword = take_token(line);
    if (keyword == "newmtl") {
      materials_.emplace_back();
      materials_.back().name = std::string(trimmed(line));
    } else if (keyword == "Kd" || keyword == "d" || keyword == "Tr" || keyword == "map_Kd") {
      if (materials_.empty()) fail(std::string(keyword) + " before the first newmtl");
      parse_value(keyword, line, materials_.back());
    }
  }

  void parse_value(std::string_view keyword, std::string_view line, MtlMaterial& material) {
    if (keyword == "map_Kd") {
      material.texture = std::string(trimmed(without_options(line)));
    } else if (keyword == "Kd") {
      parse_color(line, material);
    } else {
      std::string_view token = take_token(line);
      if (token == "-halo") token = take_token(line);
      const double value = number(token), opacity = keyword == "d" ? value : 1.0 - value;
      // Exporters disagree about what 0 means; nobody wants an invisible asset.
      if (opacity > 0.0 && opacity <= 1.0) material.color.w() = static_cast<float>(opacity);
    }
  }

  void parse_color(std::string_view line, MtlMaterial& material) {
    Eigen::Vector3f color;
    std::string_view token = take_token(line);
    if (token == "spectral" || token == "xyz") return;
    for (Eigen::Index k = 0; k < 3; ++k) {
      // One number stands for three.
      color[k] = token.empty() && k > 0 ? color[k - 1] : static_cast<float>(number(token));
      token = take_token(line);
    }
    if ((color.array() >= 0.0F).all() && (color.array() <= 1.0F).all()) material.color.head<3>() = color;
  }

  // A line behind the options of a map: -o, -s and -t have up to three numbers, -mm two, the others one word.
  static std::string_view without_options(std::string_view line) {
    for (;;) {
      std::string_view rest = line;
      const std::string_view option = take_token(rest);
      if (option.size() < 2 || option.front() != '-') return line;
      const bool is_vector = option == "-o" || option == "-s" || option == "-t";
      const int most = is_vector ? 3 : option == "-mm" ? 2 : 1;
      line = rest;
      for (int k = 0; k < most; ++k) {
        const std::string_view argument = take_token(rest);
        double value = 0.0;
        if (argument.empty() || (is_vector && !parse_number(argument, value))) break;
        line = rest;
      }
    }
  }

  std::vector<MtlMaterial> materials_;
};

class Painter {
 public:
  Painter(const std::filesystem::path& folder, PaintedMesh& painted) : folder_(folder), painted_(painted) {}

  void add_library(const std::string& named) {
    const std::filesystem::path file = folder_ / find_named_file(named, folder_);
    try {
      for (MtlMaterial& material : parse_mtl(read_file(file, kMostLibraryBytes), file.string()))
        known_.emplace(material.name, std::move(material));  // of two with one name the first, as other readers do
    } catch (const InputError& problem) {
      painted_.notes.emplace_back(problem.what());
    }
  }

  void add_material(const std::string& name) {
    Material material;
    material.name = name;
    const auto found = known_.find(name);
    if (found == known_.end()) {
      painted_.notes.push_back("material " + name + " is in no library: its faces stay white");
    } else {
      material.base_color = found->second.color;
      material.image = image_of(found->second.texture);
      if (material.image >= 0) material.base_color.head<3>().setOnes();
    }
    painted_.materials.push_back(std::move(material));
  }

 private:
  int image_of(const std::string& texture) {
    if (texture.empty()) return -1;
    const auto [known, is_new] = images_.try_emplace(texture, -1);
    if (!is_new) return known->second;
    try {
      painted_.images.push_back(read_texture(folder_ / find_named_file(texture, folder_)));
      known->second = static_cast<int>(painted_.images.size()) - 1;
    } catch (const InputError& problem) {
      painted_.notes.emplace_back(problem.what());
    }
    return known->second;
  }

  const std::filesystem::path& folder_;
  PaintedMesh& painted_;
  std::map<std::string, MtlMaterial> known_;
  std::map<std::string, int> images_;
};

}  // namespace

std::vector<MtlMaterial> parse_mtl(const std::string& text, const std::string& file) {
  refuse_utf16(text, file);
  return MtlParser(text, file).parse();
}

PaintedMesh read_painted_obj(const std::filesystem::path& path) {
  PaintedMesh painted;
  ObjMaterials named;
  painted.mesh = read_obj(path, &named);
  const std::filesystem::path folder = path.parent_path();
  Painter painter(folder, painted);
  for (const std::string& library : named.libraries) painter.add_library(library);
  for (const std::string& name : named.names) painter.add_material(name);
  return painted;
}

}  // namespace anigen::io
