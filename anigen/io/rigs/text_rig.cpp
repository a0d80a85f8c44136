#include "anigen/io/rigs/text_rig.h"

#include <fstream>
#include <sstream>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/meshes/obj_file.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/shape_parts.h"
#include "anigen/io/rigs/skin_rows.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostTextBytes = std::uintmax_t{1} << 30;

/// Positions and triangles as numbered in the file. read_obj() would add vertices at texture seams.
Mesh unsplit_mesh(const fs::path& file) {
  require_content(file);
  ObjFile obj = parse_obj(read_file(file, kMostTextBytes), file.string());
  Mesh mesh;
  for (std::size_t p = 0; p < obj.polygons.size(); ++p) {
    const std::size_t begin = obj.polygons[p].first_corner;
    const std::size_t end = p + 1 < obj.polygons.size() ? obj.polygons[p + 1].first_corner : obj.corners.size();
    const auto vertex = [&obj](std::size_t corner) { return static_cast<std::int32_t>(obj.corners[corner][0]); };
    for (std::size_t c = begin + 2; c < end; ++c) mesh.faces.push_back({vertex(begin), vertex(c - 1), vertex(c)});
  }
  mesh.vertices = std::move(obj.positions);
  return mesh;
}

}  // namespace

fs::path mesh_of_text_rig(const fs::path& rig) {
  const fs::path folder = rig.parent_path();
  const std::string stem = rig.stem().string();
  std::vector<fs::path> places = {folder / (stem + ".obj")};
  const std::string suffix = "_rig", data = "rig_info";
  if (stem.size() > suffix.size() && stem.compare(stem.size() - suffix.size(), suffix.size(), suffix) == 0)
    places.push_back(folder / (stem.substr(0, stem.size() - suffix.size()) + ".obj"));
  const std::string name = fs::absolute(folder).filename().string();
  if (name.compare(0, data.size(), data) == 0)
    places.push_back(fs::absolute(folder).parent_path() / ("obj" + name.substr(data.size())) / (stem + ".obj"));
  for (const fs::path& place : places) {
    std::error_code error;
    if (fs::is_regular_file(place, error)) return place;
  }
  return {};
}

RiggedShape read_text_rig(const fs::path& file, const std::string& id, Axes axes) {
  TextRig rig = parse_text_rig(read_file(file, kMostTextBytes), file.string());
  RiggedShape shape;
  shape.id = id;
  shape.file = file.string();
  shape.joints = std::move(rig.joints);
  shape.joint_names = std::move(rig.names);
  const fs::path mesh = mesh_of_text_rig(file);
  if (!mesh.empty()) {
    shape.mesh = unsplit_mesh(mesh);
    SkinRows rows(shape.mesh.vertices.size(), shape.joints.size(), shape.file);
    for (const TextRig::SkinLine& line : rig.skin) {
      const std::string place = "line " + std::to_string(line.line);
      if (static_cast<std::size_t>(line.vertex) >= shape.mesh.vertices.size()) {
        throw InputError(shape.file, place,
                         "weights vertex " + std::to_string(line.vertex) + " of the " +
                             std::to_string(shape.mesh.vertices.size()) + " in " + mesh.string());
      }
      for (const auto& [joint, weight] : line.weights) rows.add(line.vertex, joint, weight, place);
    }
    if (!rig.skin.empty()) set_skin(shape, rows, rig.root);
  } else {
    shape.notes.push_back("there is no " + file.stem().string() + ".obj with its mesh");
  }
  turn_to_z_up(shape, axes, Axes::kYUp);
  note_missing_parts(shape);
  return shape;
}

bool is_text_rig(const fs::path& file) {
  std::ifstream in(file);
  std::string start(4096, '\0');
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(in.gcount()));
  std::istringstream lines(start);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string first;
    if (words >> first && first.front() != '#')
      return first == "joints" || first == "root" || first == "hier" || first == "skin";
  }
  return false;
}

}  // namespace anigen::io
