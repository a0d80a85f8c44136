#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/io/arrays/npz.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// One sample dictionary of Articulation-XL 2.0 (reference anymate-baselines.md, 10.1): vertices, faces, normals,
/// joints, joint_names, bones [B, 2] (parent, child), root_index, and skin weights in coordinate form, whose keys end
/// in `_row`/`_col` or `_rows`/`_cols`; entries of one vertex and joint add up. `pc_w_norm` is on another scale and is
/// not read. Numbers stay in the file's frame.
/// @param file for messages, with the sample's id
/// @param content_id set, when not null, to the content_id() of the arrays, also when the sample is refused
/// @throws InputError naming the key: wrong sizes, indices out of range, numbers that are not finite, a joint with two
/// parents, a cycle, no joint
RiggedShape shape_from_articulation_xl(const NpzValue& sample, const std::string& id, const std::string& file,
                                       std::string* content_id = nullptr);

/// An NPZ file with one object array of such dictionaries (any name; other members, such as the stray `allow_pickle`,
/// are ignored). The whole file is read at once, which takes about three times its uncompressed size; then
/// only shapes are kept, in single precision: about 32 bytes a vertex with its normal, 12 a face, 8 a weight.
class ArticulationXlSource : public ShapeSource {
 public:
  /// @throws InputError when reading would take more memory than the machine has, no member holds sample dictionaries,
  /// a sample has no uuid, or two have the same one
  explicit ArticulationXlSource(const std::filesystem::path& file, const SourceOptions& options = {});

  std::vector<std::string> ids() const override { return ids_; }
  /// @throws InputError also for what is wrong with this sample; it does not keep the others from being read
  RiggedShape read(const std::string& id) const override;
  std::vector<std::filesystem::path> files(const std::string&) const override { return {file_}; }
  std::string describe() const override;
  /// Also for samples that cannot be read.
  std::string sample_id(const std::string& id) const override;
  bool is_single_file() const override { return ids_.size() == 1; }

  std::size_t bytes() const { return bytes_; }

 private:
  struct Sample {
    RiggedShape shape;
    std::string place, problem;  ///< of a sample that cannot be read
    std::string content_id;
    bool sound = false;
  };
  void add(NpzValue sample, std::size_t index, const SourceOptions& options);
  const Sample& sample(const std::string& id) const;

  std::string file_;
  std::vector<std::string> ids_;
  std::map<std::string, Sample> samples_;
  std::size_t bytes_ = 0;
};

}  // namespace anigen::io
