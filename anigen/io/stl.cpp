#include "anigen/io/stl.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/obj.h"

namespace anigen::io {

namespace {

constexpr std::uintmax_t kMostStlBytes = std::uintmax_t{2} << 30;
constexpr std::size_t kHeaderBytes = 84, kTriangleBytes = 50;

/// Collects triangles given by their corners' places.
class Corners {
 public:
  explicit Corners(const std::string& file) : file_(file) {}

  void add(const Eigen::Vector3f& place) {
    const Eigen::Vector3f p = place + Eigen::Vector3f::Zero();  // -0 and 0 are one place
    std::string key(sizeof(float) * 3, '\0');
    std::memcpy(key.data(), p.data(), key.size());
    const auto [known, is_new] = known_.try_emplace(std::move(key), 0);
    if (is_new) {
      known->second = face_index(mesh_.vertices.size(), file_);
      mesh_.vertices.push_back(p);
    }
    face_[corner_++] = known->second;
    if (corner_ < 3) return;
    corner_ = 0;
    any_ = true;
    if (face_[0] != face_[1] && face_[1] != face_[2] && face_[0] != face_[2]) mesh_.faces.push_back(face_);
  }

  Mesh finish() {
    if (!any_) throw InputError(file_, "", "no triangles");
    if (mesh_.faces.empty()) throw InputError(file_, "", "every triangle names a place twice: there is no surface");
    return std::move(mesh_);
  }

 private:
  const std::string& file_;
  Mesh mesh_;
  std::unordered_map<std::string, std::int32_t> known_;
  Triangle face_{};
  std::size_t corner_ = 0;
  bool any_ = false;
};

class TextReader : TextLines {
 public:
  TextReader(std::string_view text, const std::string& file) : TextLines(text, file), corners_(file) {}

  /// Names of solids may hold any words, so those lines are skipped whole.
  Mesh read() {
    while (next_line()) {
      const std::string word = lower_case(take_token(left_));
      if (word.empty() || word == "solid" || word == "endsolid") continue;
      if (word == "vertex")
        vertex();
      else if (word == "facet")
        open();
      else if (word == "endfacet")
        close();
      else if (word != "outer" && word != "endloop")
        fail("\"" + word.substr(0, 40) + "\" is none of solid, facet, outer loop, vertex, endloop, endfacet, endsolid");
    }
    if (inside_) fail("the file ends inside a facet");
    return corners_.finish();
  }

 private:
  void open() {
    if (inside_) fail("a facet begins inside another one");
    inside_ = true;
    vertices_ = 0;
  }

  void close() {
    if (!inside_ || vertices_ != 3) fail("a facet has " + std::to_string(vertices_) + " vertices in place of 3");
    inside_ = false;
  }

  void vertex() {
    if (!inside_ || ++vertices_ > 3) fail("a vertex stands outside a facet of three");
    Eigen::Vector3f place;
    for (float& x : place) {
      const std::string_view token = take_token(left_);
      double value = 0.0;
      if (!parse_number(token, value) || !std::isfinite(static_cast<float>(value)))
        fail("\"" + std::string(token.substr(0, 40)) + "\" is not a finite number");
      x = static_cast<float>(value);
    }
    corners_.add(place);
  }

  std::size_t vertices_ = 0;
  bool inside_ = false;
  Corners corners_;
};

std::uint32_t word_at(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint32_t>(little_endian(bytes.substr(at, 4)));
}

std::uint64_t announced(const std::string& bytes) {
  return bytes.size() < kHeaderBytes ? 0 : word_at(bytes, kHeaderBytes - 4);
}

bool is_text(const std::string& bytes) {
  if (bytes.size() >= kHeaderBytes && bytes.size() == kHeaderBytes + kTriangleBytes * announced(bytes)) return false;
  const std::size_t begin = bytes.find_first_not_of(" \t\r\n");
  return begin != std::string::npos && lower_case(std::string_view(bytes).substr(begin, 5)) == "solid" &&
         bytes.substr(0, 512).find('\0') == std::string::npos;
}

Mesh read_binary(const std::string& bytes, const std::string& file) {
  if (bytes.size() < kHeaderBytes)
    throw InputError(file, "byte " + std::to_string(bytes.size()), "the header is cut short");
  const std::uint64_t triangles = announced(bytes);
  if (triangles > (bytes.size() - kHeaderBytes) / kTriangleBytes) {
    throw InputError(file, "byte " + std::to_string(bytes.size()),
                     "the file ends before the " + std::to_string(triangles) +
                         " triangles that it announces: cut short, "
                         "or no STL file");
  }
  Corners corners(file);
  for (std::size_t t = 0; t < triangles; ++t) {
    for (std::size_t corner = 1; corner <= 3; ++corner) {  // the normal is first
      const std::size_t at = kHeaderBytes + kTriangleBytes * t + 12 * corner;
      Eigen::Vector3f place;
      for (std::size_t k = 0; k < 3; ++k)
        place[static_cast<Eigen::Index>(k)] = Eigen::numext::bit_cast<float>(word_at(bytes, at + 4 * k));
      if (!place.allFinite()) throw InputError(file, "byte " + std::to_string(at), "a vertex is not finite");
      corners.add(place);
    }
  }
  return corners.finish();
}

void append_word(std::string& bytes, std::uint32_t word) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>((word >> shift) & 0xFFu));
}

void append_place(std::string& bytes, const Eigen::Vector3f& place) {
  for (const float x : place) append_word(bytes, Eigen::numext::bit_cast<std::uint32_t>(x));
}

}  // namespace

Mesh read_stl(const std::filesystem::path& path) {
  const std::string file = path.string();
  const std::string bytes = read_file(path, kMostStlBytes);
  return is_text(bytes) ? TextReader(bytes, file).read() : read_binary(bytes, file);
}

void write_stl(const std::filesystem::path& path, const Mesh& mesh) {
  refuse_unsound_mesh(mesh, path.string());
  if (mesh.faces.empty()) throw InputError(path.string(), "", "the mesh has no faces");
  if (mesh.faces.size() > std::numeric_limits<std::uint32_t>::max())
    throw InputError(path.string(), "", "has more faces than the format can count");
  std::string bytes = "binary STL of AniGen in C++";  // not "solid", by which text is told
  bytes.resize(kHeaderBytes - 4, ' ');
  append_word(bytes, static_cast<std::uint32_t>(mesh.faces.size()));
  for (const Triangle& face : mesh.faces) {
    append_place(bytes, face_normal(mesh.vertices, face).cast<float>());
    for (const std::int32_t v : face) append_place(bytes, mesh.vertices[at(v)]);
    bytes.append(2, '\0');
  }
  write_file_atomically(path, bytes);
}

}  // namespace anigen::io
