#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "anigen/core/job.h"
#include "anigen/engine/generator.h"
#include "anigen/studio/job_options.h"
#include "anigen/studio/job_store.h"

namespace anigen::studio {

/// Files of a job's folder that its work makes.
inline constexpr const char* kRiggedFile = "rigged.glb";
inline constexpr const char* kPreviewFile = "preview.png";
/// The rig after its joints were edited (rebind.h).
inline constexpr const char* kEditedFile = "edited.glb";
/// Voxels of a generation, as engine::Generated has them.
inline constexpr const char* kVoxelsFile = "voxels.npz";
/// Pictures of a generation, each a PNG of this name, as they come.
inline constexpr const char* kPictures[] = {"mask", "normals", "voxels", "votes"};

/// Does jobs by the engine: an image becomes a rigged asset by a generator that stays loaded, a mesh gets a rig, a rig
/// gets motions, all with a preview and figures; a rig and its truth get scores.
class JobWork {
 public:
  /// Writes the files of the job into its folder, and note, result and scores into `record`. Generations one at a time.
  /// @throws InputError, Error as the engine does; Interrupted; WriteError
  void run(const std::filesystem::path& folder, Job& job, JobRecord& record);

 private:
  std::optional<Asset> generated(const std::filesystem::path& folder, const JobOptions& options, Job& job,
                                 JobRecord& record);

  std::unique_ptr<engine::Generator> generator_;
};

/// Options of a job. Beside an uploaded motion only motions that it names were asked for.
JobOptions options_of(const JobRecord& record);

/// Adds the clip of an uploaded motion that the job's rig has to an edit of that rig which lacks it. By the rig in
/// `folder`, since readers of uploads are for the processes of jobs. @throws InputError as engine::animate()
void add_uploaded_clip(const std::filesystem::path& folder, const JobRecord& record, const Asset& rig, Asset& edit);

/// New clips as the options ask: all motions that the body can do, or those that they name, less those of which the
/// asset has a clip.
std::vector<Animation> clips_of(const Asset& asset, const JobOptions& options, Job* job);

/// Text that JSON can hold: bytes that are no UTF-8 are replaced.
std::string as_utf8(const std::string& text);

}  // namespace anigen::studio
