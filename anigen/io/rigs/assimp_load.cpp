#include "anigen/io/rigs/assimp_load.h"

#include <assimp/config.h>
#include <assimp/postprocess.h>

#include <exception>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/rigs/assimp_scan.h"
#include "anigen/io/rigs/file_list.h"

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

}  // namespace anigen::io::assimp_import
