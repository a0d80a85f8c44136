#include "anigen/studio/submission.h"

#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/studio/job_options.h"
#include "anigen/studio/job_work.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr JsonLimits kRequestLimits{16, 100'000};

/// Last part of a path that a client says, for people: without control characters, and short.
std::string shown_name(const std::string& name) {
  const std::size_t slash = name.find_last_of("/\\");
  std::string shown;
  for (const char c : slash == std::string::npos ? name : name.substr(slash + 1))
    shown += static_cast<unsigned char>(c) < 32 || c == 127 ? '_' : c;
  if (shown.size() > 120) shown = "upload" + io::lower_extension(shown);
  return as_utf8(shown);
}

std::string field(const Form& form, const std::string& part) {
  const auto found = form.find(part);
  return found == form.end() ? "" : found->second.bytes;
}

void take_file(const Form& form, const std::string& part, UploadFormat format, Submission& submission) {
  const auto found = form.find(part);
  if (found == form.end()) throw InputError("", part, "is missing; send a form with a file of this name");
  const Upload& upload = found->second;
  if (upload.name.empty()) throw InputError("", part, "has no name; send it as a file with its extension");
  const std::string name = shown_name(upload.name);
  require_format(name, format);
  if (upload.bytes.empty()) throw InputError(name, "", "is empty");
  submission.record.names[part] = name;
  submission.files.push_back({part, io::lower_extension(name), upload.bytes});
}

/// The job, which has ended well.
JobRecord done_job(const JobStore& store, const std::string& id) {
  std::optional<JobRecord> record = store.find(id);
  if (!record) throw RequestError(404, "there is no such job");
  if (record->state != JobState::kDone)
    throw RequestError(409, std::string("the job is ") + word(record->state) + ", and has no rig");
  return *std::move(record);
}

/// The rig of another job as this one's file.
void take_rig(const JobStore& store, const std::string& id, Submission& submission) {
  const JobRecord source = job_with_rig(store, id);
  submission.record.source = id;
  submission.record.names["file"] = fs::path(source.names.at("file")).stem().string() + ".glb";
  submission.files.push_back({"file", ".glb", read_file(store.folder(id) / latest_rig(store, id))});
}

/// The voxels of an earlier generation, and its image and mask unless the form brings an image.
void take_voxels(const JobStore& store, const std::string& id, const Form& form, Submission& submission) {
  const JobRecord source = done_job(store, id);
  const fs::path folder = store.folder(id);
  std::error_code ignored;
  if (source.kind != "generation" || !fs::exists(folder / kVoxelsFile, ignored))
    throw RequestError(409, "job " + id + " has no voxels");
  submission.record.source = id;
  submission.files.push_back({"voxels", ".npz", read_file(folder / kVoxelsFile)});
  if (form.count("file") > 0) return;
  for (const char* part : {"file", "mask"}) {
    const auto input = source.inputs.find(part);
    if (input == source.inputs.end() || form.count(part) > 0) continue;
    submission.record.names[part] = source.names.at(part);
    submission.files.push_back({part, fs::path(input->second).extension(), read_file(folder / input->second)});
  }
}

}  // namespace

Json request_json(const std::string& text) {
  const Json json = parse_json(text.empty() ? "{}" : text, "request", kRequestLimits);
  if (!json.is_object()) throw InputError("request", "", "is no JSON object");
  return json;
}

JobRecord job_with_rig(const JobStore& store, const std::string& id) {
  JobRecord record = done_job(store, id);
  std::error_code ignored;
  if (fs::exists(store.folder(id) / kRiggedFile, ignored)) return record;
  throw RequestError(409, record.kind == "evaluation" ? "the job is an evaluation, and has no rig"
                                                      : "the job stopped at its voxels, and has no rig");
}

std::string latest_rig(const JobStore& store, const std::string& id) {
  std::error_code ignored;
  return fs::exists(store.folder(id) / kEditedFile, ignored) ? kEditedFile : kRiggedFile;
}

Submission submission_of(const std::string& kind, const Form& form, const JobStore& store) {
  Submission submission;
  JobRecord& record = submission.record;
  record.kind = kind;
  record.options = request_json(field(form, "options"));
  const JobOptions options = parse_job_options(record.options, kind);
  const bool of_rig = kind == "animation" || kind == "evaluation";
  if (!options.voxels_of.empty()) take_voxels(store, options.voxels_of, form, submission);
  if (of_rig && form.count("job") > 0) {
    take_rig(store, field(form, "job"), submission);
  } else if (record.names.count("file") == 0) {
    take_file(form, "file",
              kind == "generation"  ? UploadFormat::kImage
              : kind == "animation" ? UploadFormat::kRig
                                    : UploadFormat::kMesh,
              submission);
  }
  if (kind == "generation" && form.count("mask") > 0) take_file(form, "mask", UploadFormat::kMask, submission);
  if (kind == "evaluation") take_file(form, "truth", UploadFormat::kMesh, submission);
  if (kind == "animation" && form.count("motion") > 0) take_file(form, "motion", UploadFormat::kMotion, submission);
  record.name = record.names.at("file");
  return submission;
}

}  // namespace anigen::studio
