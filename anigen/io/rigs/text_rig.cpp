#include "anigen/io/rigs/text_rig.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/io/obj.h"
#include "anigen/io/rigs/rig_listing.h"

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
  const fs::path whole = fs::absolute(rig).parent_path();  // the folder of a bare file name is empty
  const std::string name = whole.filename().string();
  if (name.compare(0, data.size(), data) == 0)
    places.push_back(whole.parent_path() / ("obj" + name.substr(data.size())) / (stem + ".obj"));
  for (const fs::path& place : places) {
    std::error_code error;
    if (fs::is_regular_file(place, error)) return place;
  }
  return {};
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

namespace {

struct TextRig {
  struct SkinLine {
    std::size_t line;  ///< in the file, from 1
    std::int64_t vertex;
    std::vector<std::pair<int, float>> weights;  ///< joint, weight
  };
  anigen::JointTree joints;
  std::vector<std::string> names;
  int root = 0;
  std::vector<SkinLine> skin;
};

class TextRigParser : TextLines {
 public:
  TextRigParser(const std::string& text, const std::string& file) : TextLines(text, file), text_(text) {}

  TextRig parse() {
    for_each_line(&TextRigParser::joint_line);  // names first: other lines may stand before the joints they name
    if (rig_.joints.size() == 0) throw InputError(file_, "", "the skeleton has no joint");
    rig_.joints.parents.assign(rig_.joints.size(), -1);
    for_each_line(&TextRigParser::other_line);
    if (!has_root_) throw InputError(file_, "", "there is no root line");
    anigen::check(rig_.joints, file_);
    const int above = rig_.joints.parents[at(rig_.root)];
    if (above >= 0) {
      throw InputError(file_, "", "the root " + rig_.names[at(rig_.root)] + " has the parent " + rig_.names[at(above)]);
    }
    return std::move(rig_);
  }

 private:
  void for_each_line(void (TextRigParser::*handle)(std::string_view keyword)) {
    rest_ = text_;
    line_ = 0;
    while (next_line()) {
      const std::string_view keyword = take_token(left_);
      if (!keyword.empty() && keyword.front() != '#') (this->*handle)(keyword);
    }
  }

  void joint_line(std::string_view keyword) {
    if (keyword != "joints") return;
    const std::string name = word("a joint's name");
    Eigen::Vector3d position;
    for (double& x : position) x = number();
    end_of_line();
    if (!index_.try_emplace(name, static_cast<int>(rig_.names.size())).second)
      fail("the joint " + name + " is given twice");
    rig_.names.push_back(name);
    rig_.joints.positions.push_back(position);
  }

  void other_line(std::string_view keyword) {
    if (keyword == "joints") return;
    if (keyword == "root") {
      if (has_root_) fail("there is a second root line");
      rig_.root = joint();
      has_root_ = true;
      end_of_line();
    } else if (keyword == "hier") {
      const int parent = joint(), child = joint();
      end_of_line();
      int& known = rig_.joints.parents[at(child)];
      if (known >= 0) fail("the joint " + rig_.names[at(child)] + " already has a parent");
      known = parent;
    } else if (keyword == "skin") {
      skin_line();
    } else {
      fail("\"" + std::string(keyword.substr(0, 40)) + "\" is none of joints, root, hier, skin");
    }
  }

  void skin_line() {
    TextRig::SkinLine skin;
    skin.line = line_;
    const double vertex = number();
    if (vertex < 0 || vertex > 1e12 || vertex != std::floor(vertex)) fail("a vertex number is whole and not negative");
    skin.vertex = static_cast<std::int64_t>(vertex);
    if (!weighted_.insert(skin.vertex).second) fail("vertex " + std::to_string(skin.vertex) + " is weighted twice");
    while (left_.find_first_not_of(" \t\r") != std::string_view::npos) {
      const int target = joint();
      skin.weights.emplace_back(target, static_cast<float>(number()));
    }
    rig_.skin.push_back(std::move(skin));
  }

  std::string word(const char* what) {
    const std::string_view token = take_token(left_);
    if (token.empty()) fail(std::string("the line ends where ") + what + " should be");
    return std::string(token);
  }

  double number() { return TextLines::number(word("a number")); }

  int joint() {
    const std::string name = word("a joint's name");
    const auto found = index_.find(name);
    if (found == index_.end()) fail("there is no joint \"" + name.substr(0, 80) + "\"");
    return found->second;
  }

  void end_of_line() {
    const std::string_view token = take_token(left_);
    if (!token.empty()) fail("\"" + std::string(token.substr(0, 40)) + "\" after the end of the line's content");
  }

  const std::string& text_;
  bool has_root_ = false;
  std::map<std::string, int> index_;
  std::set<std::int64_t> weighted_;
  TextRig rig_;
};

}  // namespace

namespace {

/// Weights without the mesh that they count the vertices of. Lines number nearly all vertices, where they are a rig's.
void keep_weights_alone(const TextRig& rig, RiggedShape& shape) {
  std::size_t vertices = 0;
  for (const TextRig::SkinLine& line : rig.skin)
    vertices = std::max(vertices, static_cast<std::size_t>(line.vertex) + 1);
  constexpr std::size_t kMostGaps = 8, kFew = 1024;
  if (vertices == 0 || vertices > kMostGaps * rig.skin.size() + kFew) return;
  SkinRows rows(vertices, shape.joints.size(), shape.file);
  for (const TextRig::SkinLine& line : rig.skin) {
    for (const auto& [joint, weight] : line.weights)
      rows.add(line.vertex, joint, weight, "line " + std::to_string(line.line));
  }
  rows.finish(rig.root, shape);
}

}  // namespace

RiggedShape read_text_rig(const fs::path& file, const std::string& id, Axes axes) {
  const std::string text = read_file(file, kMostTextBytes), name = file.string();
  TextRig rig = TextRigParser(text, name).parse();
  RiggedShape shape(id, name);
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
    if (!rig.skin.empty()) rows.finish(rig.root, shape);
  } else {
    shape.notes.push_back("there is no " + file.stem().string() + ".obj with its mesh");
    keep_weights_alone(rig, shape);
  }
  turn_to_z_up(shape, axes, Axes::kYUp);
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::io
