#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace anigen::test {

/// A small rig that can be as wrong as a test wants, and writers for the formats that io/rigs reads. Two quads on a
/// chain of three joints, in the frame of the format it is written to.
struct RigFile {
  RigFile();

  std::vector<float> vertices;  ///< [V, 3]
  std::vector<int> faces;       ///< [F, 3]
  std::vector<double> joints;   ///< [J, 3]
  std::vector<int> parents;     ///< [J]
  std::vector<float> skin;      ///< row-major [skin_rows, skin_columns]
  int skin_rows, skin_columns;  ///< what the file says they are
  std::string uuid = "sample";
  bool has_skin = true, has_skeleton = true;

  int vertex_count() const { return static_cast<int>(vertices.size() / 3); }
  int joint_count() const { return static_cast<int>(joints.size() / 3); }
  /// Leaves the first `count` joints and the weights on them.
  void keep_joints(int count);
};

/// raw_data.npz: joints, parents, skin, vertices, faces.
void write_rig_npz(const std::filesystem::path& path, const RigFile& rig);

struct XlOptions {
  std::string row_suffix;      ///< "s": the published writer's …_rows and …_cols
  bool halve_entries = false;  ///< every weight as two entries of half its size
  bool stray_member = true;    ///< `allow_pickle`
};
/// An NPZ file of sample dictionaries as numpy.savez pickles them.
void write_articulation_xl(const std::filesystem::path& path, const std::vector<RigFile>& rigs,
                           const XlOptions& options = {});

/// <path> and the .obj beside it. Joints are called j0, j1, ….
void write_text_rig(const std::filesystem::path& path, const RigFile& rig);
std::string text_rig(const RigFile& rig);
std::string obj_text(const RigFile& rig);

/// A torch archive with a list of Anymate samples; `rig.skin` counts for bones, which are the joints with a parent.
void write_anymate(const std::filesystem::path& path, const std::vector<RigFile>& rigs, bool whole_mesh = true);

/// For write_anymate: the weights of the last joint go to the one before, since no bone starts at the end of a chain.
RigFile per_bone(RigFile rig);

/// A .glb with its frame taken as Z up. The rig must be sound.
void write_glb(const std::filesystem::path& path, const RigFile& rig);

/// Text of an InputError: "<place>: <problem>"; "" when nothing is thrown.
std::string refusal(const std::function<void()>& action);

}  // namespace anigen::test
