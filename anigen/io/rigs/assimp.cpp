#include "anigen/io/rigs/assimp.h"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <exception>
#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/obj.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::io::assimp_import {

namespace {

class SceneCheck {
 public:
  SceneCheck(const aiScene& scene, const std::string& file, const ImportOptions& options)
      : scene_(scene), file_(file), options_(options) {}

  void run() {
    if (scene_.mRootNode == nullptr) fail("", "there is no scene");
    present(scene_.mMeshes, scene_.mNumMeshes, "meshes");
    present(scene_.mMaterials, scene_.mNumMaterials, "materials");
    present(scene_.mAnimations, scene_.mNumAnimations, "animations");
    present(scene_.mTextures, scene_.mNumTextures, "textures");
    for (unsigned m = 0; m < scene_.mNumMeshes; ++m) check_mesh(*scene_.mMeshes[m], m);
    check_nodes();
    for (unsigned a = 0; a < scene_.mNumAnimations; ++a) check_animation(*scene_.mAnimations[a]);
  }

 private:
  [[noreturn]] void fail(const std::string& place, const std::string& problem) const {
    throw InputError(file_, place, problem);
  }

  template <typename T>
  void present(T* const* list, unsigned count, const std::string& what) const {
    if (count > 0 && list == nullptr) fail(what, "are missing");
    for (unsigned i = 0; i < count; ++i) {
      if (list[i] == nullptr) fail(what, "number " + std::to_string(i) + " is missing");
    }
  }

  void check_mesh(const aiMesh& mesh, unsigned number) {
    const std::string place = "mesh " + std::to_string(number);
    vertices_ += mesh.mNumVertices;
    faces_ += mesh.mNumFaces;
    if (vertices_ > options_.max_vertices) fail(place, "the file has more vertices than the importer's limit");
    if (faces_ > options_.max_faces) fail(place, "the file has more faces than the importer's limit");
    if (mesh.mNumVertices > 0 && mesh.mVertices == nullptr) fail(place, "has no positions");
    if (mesh.mNumFaces > 0 && mesh.mFaces == nullptr) fail(place, "has no faces");
    if (mesh.mMaterialIndex >= scene_.mNumMaterials && scene_.mNumMaterials > 0) fail(place, "has no such material");
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      for (unsigned c = 0; c < face.mNumIndices; ++c) {
        if (face.mIndices[c] >= mesh.mNumVertices)
          fail(place, "face " + std::to_string(f) + " names vertex " + std::to_string(face.mIndices[c]) + " of " +
                          std::to_string(mesh.mNumVertices));
      }
    }
    present(mesh.mBones, mesh.mNumBones, place + " bones");
    for (unsigned b = 0; b < mesh.mNumBones; ++b) {
      const aiBone& bone = *mesh.mBones[b];
      if (bone.mNumWeights > 0 && bone.mWeights == nullptr) fail(place, "a bone's weights are missing");
      for (unsigned w = 0; w < bone.mNumWeights; ++w) {
        if (bone.mWeights[w].mVertexId >= mesh.mNumVertices)
          fail(place, std::string("bone ") + bone.mName.C_Str() + " weights vertex " +
                          std::to_string(bone.mWeights[w].mVertexId) + " of " + std::to_string(mesh.mNumVertices));
      }
    }
  }

  void check_nodes() const {
    std::vector<const aiNode*> open = {scene_.mRootNode};
    std::size_t nodes = 0;
    while (!open.empty()) {
      const aiNode& node = *open.back();
      open.pop_back();
      nodes += 1 + node.mNumMeshes;
      if (nodes > options_.max_nodes) fail("", "more nodes than the limit of " + std::to_string(options_.max_nodes));
      for (unsigned m = 0; m < node.mNumMeshes; ++m) {
        if (node.mMeshes == nullptr || node.mMeshes[m] >= scene_.mNumMeshes)
          fail(std::string("node ") + node.mName.C_Str(), "shows a mesh that is not there");
      }
      present(node.mChildren, node.mNumChildren, "nodes");
      for (unsigned c = 0; c < node.mNumChildren; ++c) open.push_back(node.mChildren[c]);
    }
  }

  void check_animation(const aiAnimation& animation) const {
    const std::string place = std::string("animation ") + animation.mName.C_Str();
    present(animation.mChannels, animation.mNumChannels, place);
    for (unsigned c = 0; c < animation.mNumChannels; ++c) {
      const aiNodeAnim& channel = *animation.mChannels[c];
      if ((channel.mNumPositionKeys > 0 && channel.mPositionKeys == nullptr) ||
          (channel.mNumRotationKeys > 0 && channel.mRotationKeys == nullptr) ||
          (channel.mNumScalingKeys > 0 && channel.mScalingKeys == nullptr))
        fail(place, "keys are missing");
    }
  }

  const aiScene& scene_;
  const std::string& file_;
  const ImportOptions& options_;
  std::size_t vertices_ = 0, faces_ = 0;
};

/// Assimp's own words are for programmers; the first line says enough.
[[noreturn]] void refuse(const std::string& file, std::string words) {
  words = words.substr(0, std::min<std::size_t>(words.find('\n'), 300));
  throw InputError(file, "", "Assimp cannot read it: " + (words.empty() ? "it does not say why" : words));
}

}  // namespace

const aiScene& load(Assimp::Importer& importer, const std::filesystem::path& path, const ImportOptions& options,
                    FileFrame& frame) {
  const std::string file = path.string();
  const std::string extension = lower_extension(path);
  if (extension != ".fbx" && extension != ".dae") throw NotSupportedError(file, "", extension + " files");
  std::string bytes = read_file(path, options.max_file_bytes);
  if (extension == ".dae")
    frame = scan_collada(bytes, file, options.max_nodes);
  else
    scan_fbx(bytes, options.max_nodes, file);
  if (extension == ".dae") mend_collada(bytes);

  importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_REMOVE_EMPTY_BONES, false);  // joints are joints without weights, too
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);   // else it draws one where there is no mesh
  importer.SetPropertyBool(AI_CONFIG_IMPORT_FBX_READ_CAMERAS, false);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_FBX_READ_LIGHTS, false);
  try {
    // From memory, so that no file is opened beside this one.
    const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, extension.c_str() + 1);
    if (scene == nullptr) refuse(file, importer.GetErrorString());
    SceneCheck(*scene, file, options).run();
    scene = importer.ApplyPostProcessing(aiProcess_Triangulate | aiProcess_SortByPType);
    if (scene == nullptr) refuse(file, importer.GetErrorString());
    SceneCheck(*scene, file, options).run();
    return *scene;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    refuse(file, error.what());
  }
}

namespace {

constexpr std::size_t kMostNested = 1024;

/// End of a tag: the '>' outside quotes; npos when there is none.
std::size_t end_of_tag(std::string_view text, std::size_t from) {
  char quote = 0;
  for (std::size_t i = from; i < text.size(); ++i) {
    const char c = text[i];
    if (quote != 0)
      quote = c == quote ? 0 : quote;
    else if (c == '"' || c == '\'')
      quote = c;
    else if (c == '>')
      return i;
  }
  return std::string_view::npos;
}

/// <asset> lies in the root element; others, of a library's parts, say nothing about the scene.
constexpr std::size_t kDepthOfAxes = 3;

bool is_element(std::string_view tag, std::string_view name) {
  return tag.size() > name.size() + 1 && tag.substr(1, name.size()) == name &&
         std::string_view(" \t\r\n>/").find(tag[name.size() + 1]) != std::string_view::npos;
}

constexpr std::string_view kBlanks = " \t\r\n", kStartsOfNumbers = "+-.0123456789";

bool is_blank(char c) { return kBlanks.find(c) != std::string_view::npos; }

void read_up(std::string_view content, FileFrame& frame) {
  while (!content.empty() && is_blank(content.front())) content.remove_prefix(1);
  const std::string_view word = content.substr(0, 4);
  if (word == "X_UP" || word == "Y_UP" || word == "Z_UP") frame.up = word[0];
}

/// The value of ` name="value"` in a tag; empty without it.
std::string_view attribute(std::string_view tag, std::string_view name) {
  for (std::size_t at = tag.find(name); at != std::string_view::npos; at = tag.find(name, at + 1)) {
    const std::size_t equals = at + name.size();
    if (!is_blank(tag[at - 1]) || tag.size() < equals + 3 || tag[equals] != '=') continue;
    const std::size_t end = tag.find(tag[equals + 1], equals + 2);
    if (end != std::string_view::npos) return tag.substr(equals + 2, end - equals - 2);
  }
  return {};
}

void read_unit(std::string_view tag, FileFrame& frame) {
  double metres = 0.0;
  if (parse_number(attribute(tag, "meter"), metres) && metres > 0.0 && std::isfinite(metres)) frame.metres = metres;
}

/// Collects the scene graph from the tags of nodes, each of which hangs on the node around it and on every node that
/// names it in an instance_node.
class NodeTags {
 public:
  void open(std::string_view id) {
    const std::int64_t node = id.empty() ? next_++ : number(id);
    graph_.nodes.push_back(node);
    graph_.links.emplace_back(node, around());
    open_.push_back(node);
  }
  void close() {
    if (!open_.empty()) open_.pop_back();
  }
  void instance(std::string_view url) {
    if (!url.empty() && url.front() == '#') url.remove_prefix(1);
    graph_.links.emplace_back(number(url), around());
  }
  const SceneGraph& graph() const { return graph_; }

 private:
  std::int64_t around() const { return open_.empty() ? 0 : open_.back(); }
  std::int64_t number(std::string_view id) {
    const auto [there, is_new] = numbers_.try_emplace(id, next_);
    next_ += is_new ? 1 : 0;
    return there->second;
  }

  std::unordered_map<std::string_view, std::int64_t> numbers_;
  std::int64_t next_ = 1;
  std::vector<std::int64_t> open_;
  SceneGraph graph_;
};

}  // namespace

void mend_collada(std::string& text) {
  for (std::size_t at = text.find('>'); at != std::string::npos; at = text.find('>', at + 1)) {
    const std::size_t first = text.find_first_not_of(kBlanks, at + 1);
    if (first == std::string::npos || first == at + 1 || kStartsOfNumbers.find(text[first]) == std::string_view::npos)
      continue;
    const auto begin = text.begin() + static_cast<std::ptrdiff_t>(at + 1);
    const auto end = text.begin() + static_cast<std::ptrdiff_t>(std::min(text.find('<', first), text.size()));
    std::rotate(begin, text.begin() + static_cast<std::ptrdiff_t>(first), end);
  }
}

FileFrame scan_collada(std::string_view text, const std::string& file, std::size_t max_nodes) {
  refuse_utf16(text, file);
  FileFrame frame;
  NodeTags nodes;
  std::size_t depth = 0;
  for (std::size_t at = text.find('<'); at != std::string_view::npos; at = text.find('<', at)) {
    const std::string_view rest = text.substr(at);
    const std::string place = "byte " + std::to_string(at);
    constexpr std::pair<std::string_view, std::string_view> kSkipped[] = {
        {"<!--", "-->"}, {"<![CDATA[", "]]>"}, {"<?", "?>"}};
    const auto* skipped = std::find_if(std::begin(kSkipped), std::end(kSkipped), [&rest](const auto& part) {
      return rest.substr(0, part.first.size()) == part.first;
    });
    if (skipped != std::end(kSkipped)) {
      const std::size_t found = text.find(skipped->second, at + skipped->first.size());
      at = found == std::string_view::npos ? text.size() : found + skipped->second.size();
      continue;
    }
    if (rest.substr(0, 2) == "<!") throw NotSupportedError(file, place, "COLLADA with a DOCTYPE");
    const std::size_t end = end_of_tag(text, at + 1);
    if (end == std::string_view::npos) throw InputError(file, place, "a tag is not closed");
    const bool is_empty = text[end - 1] == '/';
    if (rest.substr(0, 2) == "</") {
      depth -= depth > 0 ? 1 : 0;
      if (is_element(rest.substr(1), "node")) nodes.close();
    } else if (!is_empty) {
      if (++depth > kMostNested)
        throw InputError(file, place, "elements are nested deeper than " + std::to_string(kMostNested));
    }
    const std::string_view tag = text.substr(at, end - at);
    if (is_element(rest, "node")) nodes.open(attribute(tag, "id"));
    if (is_element(rest, "node") && is_empty) nodes.close();
    if (is_element(rest, "instance_node")) nodes.instance(attribute(tag, "url"));
    if (is_element(rest, "up_axis") && depth <= kDepthOfAxes) read_up(text.substr(end + 1), frame);
    if (is_element(rest, "unit") && depth <= kDepthOfAxes) read_unit(tag, frame);
    at = end + 1;
  }
  check_graph(nodes.graph(), max_nodes, "nodes", "instance_node", file);
  return frame;
}

namespace {

constexpr std::size_t kMostNestedRecords = 64, kMostNestedNodes = 1024;
constexpr std::string_view kBinaryMagic = "Kaydara FBX Binary";  // as much of it as Assimp looks at
constexpr std::uint64_t kMostArrayBytes = std::uint64_t{4} << 30;

class BinaryScanner {
 public:
  BinaryScanner(std::string_view bytes, const std::string& file) : bytes_(bytes), file_(file) {}

  SceneGraph scan() {
    constexpr std::size_t kHeader = 27;
    if (bytes_.size() < kHeader) fail(bytes_.size(), "the header is cut short");
    wide_ = number(23, 4) >= 7500;
    const std::size_t field = wide_ ? 8 : 4, head = 3 * field + 1;
    std::size_t at = kHeader;
    while (at + head <= bytes_.size()) {
      if (!open_.empty() && at >= open_.back().end) {
        open_.pop_back();
        continue;
      }
      const std::uint64_t end = number(at, field);
      if (end == 0) {  // closes a list; at the top it ends the file
        if (open_.empty()) break;
        if (at + head != open_.back().end) fail(at, "an empty record stands in the middle of a list");
        at = open_.back().end;
        continue;
      }
      const std::uint64_t properties = number(at + 2 * field, field);
      const std::size_t name_size = static_cast<unsigned char>(bytes_[at + 3 * field]);
      const std::uint64_t limit = open_.empty() ? bytes_.size() : open_.back().end;
      if (end <= at || end > limit) fail(at, "a record does not end inside the one around it");
      const std::size_t first = at + head + name_size;
      if (first > end || properties > end - first) fail(at, "a record's properties do not fit into it");
      const std::string_view name = bytes_.substr(at + head, name_size);
      collect(name, first, first + static_cast<std::size_t>(properties));
      count_arrays(first, first + static_cast<std::size_t>(properties));
      if (first + properties == end) {
        at = static_cast<std::size_t>(end);
        continue;
      }
      if (open_.size() >= kMostNestedRecords)
        fail(at, "records are nested deeper than " + std::to_string(kMostNestedRecords));
      open_.push_back({name, static_cast<std::size_t>(end)});
      at = first + static_cast<std::size_t>(properties);
    }
    return std::move(graph_);
  }

 private:
  struct Open {
    std::string_view name;
    std::size_t end;
  };

  [[noreturn]] void fail(std::size_t at, const std::string& problem) const {
    throw InputError(file_, "byte " + std::to_string(at), problem);
  }

  std::uint64_t number(std::size_t at, std::size_t size) const { return little_endian(bytes_.substr(at, size)); }

  /// A 64-bit property at `at`, which moves behind it.
  bool take_id(std::size_t& at, std::size_t end, std::int64_t& id) const {
    if (at + 9 > end || bytes_[at] != 'L') return false;
    id = static_cast<std::int64_t>(number(at + 1, 8));
    at += 9;
    return true;
  }

  void collect(std::string_view name, std::size_t at, std::size_t end) {
    if (open_.size() != 1) return;
    std::int64_t child = 0, parent = 0;
    if (open_[0].name == "Objects" && name == "Model") {
      if (take_id(at, end, child)) graph_.nodes.push_back(child);
    } else if (open_[0].name == "Connections") {
      if (at + 5 > end || bytes_[at] != 'S') return;
      const std::uint64_t size = number(at + 1, 4);
      if (size > end - at - 5) return;
      at += 5 + static_cast<std::size_t>(size);
      if (take_id(at, end, child) && take_id(at, end, parent)) graph_.links.emplace_back(child, parent);
    }
  }

  /// Adds up what the arrays among a record's properties say they unpack to: Assimp reserves that before it reads.
  void count_arrays(std::size_t at, std::size_t end) {
    while (at < end) {
      const std::size_t start = at;
      const char type = bytes_[at++];
      std::uint64_t size = 0;
      const std::size_t number_type = std::string_view("CYIFDL").find(type);
      if (number_type != std::string_view::npos) {
        constexpr std::uint64_t kSizes[] = {1, 2, 4, 4, 8, 8};
        size = kSizes[number_type];
      } else if (type == 'S' || type == 'R') {
        if (end - at < 4) return;
        size = 4 + number(at, 4);
      } else if (type == 'c' || type == 'b' || type == 'f' || type == 'i' || type == 'd' || type == 'l') {
        if (end - at < 12) return;
        claimed_ += number(at, 4) * (type == 'c' || type == 'b' ? 1 : type == 'd' || type == 'l' ? 8 : 4);
        size = 12 + number(at + 8, 4);
        if (claimed_ > kMostArrayBytes) fail(start, "the arrays up to here unpack to more than 4 GiB");
      } else {
        return;  // Assimp says what is wrong
      }
      if (size > end - at) return;
      at += static_cast<std::size_t>(size);
    }
  }

  std::string_view bytes_;
  const std::string& file_;
  bool wide_ = false;
  std::uint64_t claimed_ = 0;
  std::vector<Open> open_;
  SceneGraph graph_;
};

/// Statements are `Name: value, value, … { statements }`.
class TextScanner {
 public:
  TextScanner(std::string_view text, const std::string& file) : text_(text), file_(file) {}

  SceneGraph scan() {
    std::size_t at = 0;
    while (at < text_.size()) {
      const char c = text_[at];
      if (c == ';') {
        at = std::min(text_.find('\n', at), text_.size());
      } else if (c == '"') {
        const std::size_t end = text_.find('"', at + 1);
        at = end == std::string_view::npos ? text_.size() : end + 1;
      } else if (c == '{') {
        flush();
        if (open_.size() >= kMostNestedRecords) {
          throw InputError(file_, "byte " + std::to_string(at),
                           "blocks are nested deeper than " + std::to_string(kMostNestedRecords));
        }
        open_.push_back(name_);
        name_ = {};
        ++at;
      } else if (c == '}') {
        flush();
        name_ = {};
        if (!open_.empty()) open_.pop_back();
        ++at;
      } else if (is_word(c)) {
        at = take_word(at);
      } else {
        ++at;
      }
    }
    flush();
    return std::move(graph_);
  }

 private:
  static bool is_word(char c) {
    return std::isspace(static_cast<unsigned char>(c)) == 0 &&
           std::string_view(",{}\":;").find(c) == std::string_view::npos;
  }

  std::size_t take_word(std::size_t at) {
    std::size_t end = at + 1;
    while (end < text_.size() && is_word(text_[end])) ++end;
    const std::string_view word = text_.substr(at, end - at);
    if (end < text_.size() && text_[end] == ':') {
      flush();
      name_ = word;
      return end + 1;
    }
    std::uint64_t value = 0;  // as Assimp reads an id: the digits in front count, whatever follows
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc() && numbers_.size() < 2) numbers_.push_back(static_cast<std::int64_t>(value));
    return end;
  }

  void flush() {
    if (open_.size() == 1 && open_[0] == "Objects" && name_ == "Model" && !numbers_.empty())
      graph_.nodes.push_back(numbers_[0]);
    if (open_.size() == 1 && open_[0] == "Connections" && numbers_.size() == 2)
      graph_.links.emplace_back(numbers_[0], numbers_[1]);
    numbers_.clear();
  }

  std::string_view text_;
  const std::string& file_;
  std::vector<std::string_view> open_;  ///< names of the blocks around
  std::string_view name_;               ///< of the statement at hand
  std::vector<std::int64_t> numbers_;   ///< its first two whole numbers
  SceneGraph graph_;
};

}  // namespace

// Walks the nodes below the scene in an order that has parents first (Kahn).
void check_graph(const SceneGraph& graph, std::size_t max_nodes, const std::string& what, const std::string& place,
                 const std::string& file) {
  std::unordered_map<std::int64_t, std::size_t> number;
  number.emplace(0, 0);  // the root, which is no object
  for (const std::int64_t node : graph.nodes) number.emplace(node, number.size());
  std::vector<std::vector<std::size_t>> children(number.size());
  std::vector<std::size_t> parents_left(number.size(), 0);
  for (const auto& [child, parent] : graph.links) {
    const auto c = number.find(child), p = number.find(parent);
    if (c == number.end() || p == number.end() || child == 0) continue;
    children[p->second].push_back(c->second);
  }
  std::vector<char> reached(number.size(), 0);
  std::vector<std::size_t> queue = {0};
  reached[0] = 1;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    for (const std::size_t child : children[queue[k]]) {
      ++parents_left[child];
      if (reached[child] != 0) continue;
      reached[child] = 1;
      queue.push_back(child);
    }
  }
  const std::size_t reachable = queue.size();
  std::vector<std::size_t> depth(number.size(), 0);
  std::vector<double> copies(number.size(), 0.0);  // how often the tree that Assimp makes repeats a node
  copies[0] = 1.0;
  double total = 0.0;
  queue = {0};
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const std::size_t one = queue[k];
    total += copies[one];
    if (depth[one] > kMostNestedNodes)
      throw InputError(file, place, what + " are nested deeper than " + std::to_string(kMostNestedNodes));
    for (const std::size_t child : children[one]) {
      copies[child] += copies[one];
      depth[child] = std::max(depth[child], depth[one] + 1);
      if (--parents_left[child] == 0) queue.push_back(child);
    }
  }
  if (queue.size() != reachable)
    throw InputError(file, place,
                     "a " + what.substr(0, what.size() - 1) + " is its own ancestor: the scene graph has a cycle");
  if (!(total <= static_cast<double>(max_nodes)))
    throw InputError(file, place, "the scene graph has more nodes than the limit of " + std::to_string(max_nodes));
}

void scan_fbx(std::string_view bytes, std::size_t max_nodes, const std::string& file) {
  const bool is_binary = bytes.substr(0, kBinaryMagic.size()) == kBinaryMagic;
  const SceneGraph graph = is_binary ? BinaryScanner(bytes, file).scan() : TextScanner(bytes, file).scan();
  check_graph(graph, max_nodes, "models", "Connections", file);
}

}  // namespace anigen::io::assimp_import
