#pragma once
#include <string>
#include <vector>

#include "anigen/studio/job_store.h"
#include "anigen/studio/request.h"

namespace anigen::studio {

/// A job that is asked for, with its files.
struct Submission {
  JobRecord record;
  std::vector<InputFile> files;
};

/// Reads the form of a new job: its `file`, for animations and evaluations in place of it the `job` (ID) whose latest
/// rig it is; `mask` of a generation, `motion` of an animation, `truth` of an evaluation; `options`, a JSON text. A
/// generation with the voxels of another one has its image and mask, too, where it brings none.
/// @param kind one of job_kinds() @throws RequestError when the named job has no rig or no voxels; InputError naming
/// the part that is missing, empty or of another format, or the option that is unknown or out of range
Submission submission_of(const std::string& kind, const Form& form, const JobStore& store);

/// The job, which has ended well and has a rig. @throws RequestError 404, 409
JobRecord job_with_rig(const JobStore& store, const std::string& id);

/// File of the latest rig of a job's folder: kEditedFile where there is one, else kRiggedFile.
std::string latest_rig(const JobStore& store, const std::string& id);

/// A JSON object that a client sends; an empty text is an empty one. @throws InputError
Json request_json(const std::string& text);

}  // namespace anigen::studio
