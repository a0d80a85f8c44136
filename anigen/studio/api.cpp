#include "anigen/studio/api.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/engine/evaluate.h"
#include "anigen/engine/files.h"
#include "anigen/studio/job_options.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/rebind.h"
#include "anigen/studio/rig_formats.h"
#include "anigen/studio/submission.h"
#include "anigen/studio/weight_strokes.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostMethods = 6;
struct FileType {
  const char* name;
  const char* type;
  const char* made_of;  ///< the file of the job that it is converted from; null: it is there or not
};

constexpr FileType kFiles[] = {
    {"rigged.glb", "model/gltf-binary", nullptr},
    {"rigged.fbx", "application/octet-stream", kRiggedFile},
    {"rigged.usdz", "model/vnd.usdz+zip", kRiggedFile},
    {"rigged.vrm", "model/gltf-binary", kRiggedFile},
    {"rigged.zip", "application/zip", kRiggedFile},
    {"edited.glb", "model/gltf-binary", nullptr},
    {"edited.fbx", "application/octet-stream", kEditedFile},
    {"edited.usdz", "model/vnd.usdz+zip", kEditedFile},
    {"edited.vrm", "model/gltf-binary", kEditedFile},
    {"edited.zip", "application/zip", kEditedFile},
    {"preview.png", "image/png", nullptr},
    {"mask.png", "image/png", nullptr},
    {"normals.png", "image/png", nullptr},
    {"voxels.png", "image/png", nullptr},
    {"votes.png", "image/png", nullptr},
};

Reply reply_of(const Json& json, int status = 200) {
  Reply reply;
  reply.status = status;
  reply.body = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  return reply;
}

/// Name of a download that a header can hold.
std::string header_name(const std::string& stem, const std::string& extension) {
  std::string name;
  for (const char c : stem)
    name += (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_') ? c : '_';
  return name.substr(0, 80) + extension;
}

/// An asset of a job as a file of another format. @throws RequestError when it cannot be one
void convert(const Asset& asset, const fs::path& file) {
  try {
    write_rig_file(asset, file);
  } catch (const InputError& error) {
    throw RequestError(409, error.what());
  }
}

std::string milliseconds_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

double milliseconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

JobRecord Api::known(const std::string& id) const {
  std::optional<JobRecord> record = store_.find(id);
  if (!record) throw RequestError(404, "there is no such job");
  return *std::move(record);
}

Json Api::described(const JobRecord& record) const {
  Json json = to_json(record);
  json.erase("inputs");
  std::optional<JobRunner::Progress> progress;
  if (!has_ended(record.state)) progress = runner_.progress(record.id);
  json["stage"] = progress ? progress->stage : "";
  json["fraction"] = record.state == JobState::kDone ? 1.0 : progress ? progress->fraction : 0.0;
  json["seconds_left"] = nullptr;
  if (progress && progress->seconds_left) json["seconds_left"] = std::round(*progress->seconds_left);
  std::error_code ignored;
  const fs::path folder = store_.folder(record.id);
  json["edited"] = fs::exists(folder / kEditedFile, ignored);
  json["pictures"] = Json::array();
  for (const char* name : kPictures)
    if (fs::exists(folder / (std::string(name) + ".png"), ignored)) json["pictures"].push_back(name);
  return json;
}

Reply Api::submit(const std::string& kind, const Form& form) {
  const Submission submission = submission_of(kind, form, store_);
  const std::optional<JobRecord> accepted = runner_.submit(submission.record, submission.files);
  if (!accepted) throw RequestError(429, "too many jobs wait; try again when one has ended");
  return reply_of(described(*accepted), 201);
}

Reply Api::list() const {
  Json jobs = Json::array();
  for (const JobRecord& record : store_.list()) jobs.push_back(described(record));
  return reply_of({{"jobs", jobs}});
}

Reply Api::metrics() const {
  std::map<std::string, std::size_t> counts;
  for (const JobState state :
       {JobState::kQueued, JobState::kRunning, JobState::kDone, JobState::kFailed, JobState::kCancelled})
    counts[word(state)] = 0;
  for (const JobRecord& record : store_.list()) ++counts[word(record.state)];
  Reply reply;
  reply.type = "text/plain; version=0.0.4";
  reply.body = "# TYPE anigen_jobs gauge\n";
  for (const auto& [state, count] : counts)
    reply.body += "anigen_jobs{state=\"" + state + "\"} " + std::to_string(count) + "\n";
  return reply;
}

Reply Api::ready() const {
  if (!runner_.accepts()) throw RequestError(503, "too many jobs wait, or the studio is stopping");
  return reply_of({{"status", "ready"}});
}

Api::Event Api::event(const std::string& id) const {
  const JobRecord record = known(id);
  return {reply_of(described(record)).body, has_ended(record.state)};
}

Reply Api::show(const std::string& id) const { return reply_of(described(known(id))); }

Reply Api::end(const std::string& id) {
  if (has_ended(known(id).state)) {
    if (store_.remove(id)) return reply_of({{"removed", id}});
    throw RequestError(404, "there is no such job");
  }
  if (!runner_.cancel(id) && !has_ended(known(id).state))
    throw RequestError(409, "the job is just changing; try again");
  return reply_of(described(known(id)), 202);
}

Reply Api::file(const std::string& id, const std::string& name) {
  const JobRecord record = known(id);
  const fs::path folder = store_.folder(id);
  Reply reply;
  if (name == "input") {
    const auto input = record.inputs.find("file");
    if (input == record.inputs.end()) throw RequestError(404, "the job has no input");
    reply.type = "application/octet-stream";
    reply.body = read_file(folder / input->second);
    reply.headers["Content-Disposition"] = "attachment";
    return reply;
  }
  const auto* type =
      std::find_if(std::begin(kFiles), std::end(kFiles), [&](const FileType& f) { return name == f.name; });
  if (type == std::end(kFiles)) throw RequestError(404, "a job has no such file");
  const fs::path path = folder / name;
  if (type->made_of != nullptr && fs::exists(folder / type->made_of)) {
    const std::lock_guard<std::mutex> turn(computing_);
    if (!fs::exists(path)) {
      Asset asset = *asset_of(id, type->made_of);
      if (const std::string stem = fs::path(record.name).stem().string(); !stem.empty()) asset.name = stem;
      convert(asset, path);
    }
  }
  if (!fs::exists(path)) throw RequestError(404, "the job has no " + name);
  reply.type = type->type;
  reply.body = read_file(path);
  const std::string stem = fs::path(record.name).stem().string() + (name.rfind("edited", 0) == 0 ? "_edited" : "");
  if (path.extension() != ".png")
    reply.headers["Content-Disposition"] = "attachment; filename=\"" + header_name(stem, path.extension()) + "\"";
  return reply;
}

/// @pre computing_ is held
std::shared_ptr<const Asset> Api::asset_of(const std::string& id, const std::string& file) {
  const fs::path path = store_.folder(id) / file;
  const fs::file_time_type time = fs::last_write_time(path);
  if (loaded_ != path || time != loaded_time_ || !asset_) {
    asset_ = std::make_shared<const Asset>(engine::load(path));
    loaded_ = path;
    loaded_time_ = time;
  }
  return asset_;
}

/// Adds the clips that the job made, as far as an edit of its rig lacks them. @pre computing_ is held
void Api::add_clips(const JobRecord& record, Asset& edit) {
  if (record.inputs.count("motion") > 0)
    add_uploaded_clip(store_.folder(record.id), record, *asset_of(record.id, kRiggedFile), edit);
  for (Animation& clip : clips_of(edit, options_of(record), nullptr)) edit.animations.push_back(std::move(clip));
}

/// The rig whose weights an edit keeps: that of the job itself, or after new names the edited one.
std::shared_ptr<const Asset> Api::asset_with(const std::string& id, const Skeleton& skeleton) {
  std::shared_ptr<const Asset> own = asset_of(id, kRiggedFile);
  if (has_joints(*own, skeleton) || latest_rig(store_, id) == kRiggedFile) return own;
  std::shared_ptr<const Asset> edited = asset_of(id, kEditedFile);
  return has_joints(*edited, skeleton) ? edited : own;
}

void Api::keep_edit(const std::string& id, const std::string& glb) const {
  const fs::path folder = store_.folder(id);
  for (const FileType& type : kFiles) {
    if (type.made_of != nullptr && std::string(type.made_of) == kEditedFile) remove_lastingly(folder / type.name);
  }
  write_file_atomically(folder / kEditedFile, glb);
}

Reply Api::rebind(const std::string& id, const std::string& body) {
  const JobRecord record = job_with_rig(store_, id);
  const Json request = request_json(body);
  ConfigReader reader(request, "request");
  reader.require("joints");
  const Skeleton skeleton = skeleton_of_joints(*reader.raw("joints"));
  const Skeleton former = with_former_names(skeleton, *reader.raw("joints"));
  const std::string method = reader.choice("method", "heat", {"heat", "geovoxel", "nearest", "keep"});
  const Json* given = reader.raw("strokes");
  const bool draft = reader.boolean("draft", false);
  reader.finish();
  const std::lock_guard<std::mutex> turn(computing_);
  const auto started = std::chrono::steady_clock::now();
  Rebound bound = method == "keep" ? with_kept_weights(*asset_with(id, former), former)
                                   : rebound(*asset_of(id, kRiggedFile), skeleton, method);
  if (method == "keep") rename_joints(former, skeleton.names, bound.asset);
  const auto painting = std::chrono::steady_clock::now();
  // By the joints of the asset, whose order can be its own.
  if (given != nullptr) apply_strokes(parse_strokes(*given, bound.asset.skeleton), bound.asset);
  bound.milliseconds += milliseconds_since(painting);
  if (draft) {
    bound.asset.animations.clear();
  } else {
    add_clips(record, bound.asset);
  }
  Reply reply;
  reply.type = "model/gltf-binary";
  reply.body = engine::save_bytes(bound.asset, "glb");
  if (!draft) keep_edit(id, reply.body);
  reply.headers = {{"X-Bind-Milliseconds", milliseconds_text(bound.milliseconds)},
                   {"X-Total-Milliseconds", milliseconds_text(milliseconds_since(started))}};
  return reply;
}

Reply Api::rename(const std::string& id, const std::string& body) {
  const JobRecord record = job_with_rig(store_, id);
  const Json request = request_json(body);
  ConfigReader reader(request, "request");
  reader.require("names");
  const std::string preset = reader.choice("names", "chain", name_presets());
  reader.finish();
  const std::lock_guard<std::mutex> turn(computing_);
  Asset asset;
  try {
    asset = renamed(*asset_of(id, latest_rig(store_, id)), preset);
  } catch (const InputError& error) {
    throw RequestError(409, error.what());
  }
  add_clips(record, asset);
  Reply reply;
  reply.type = "model/gltf-binary";
  reply.body = engine::save_bytes(asset, "glb");
  keep_edit(id, reply.body);
  return reply;
}

Reply Api::lint(const std::string& id) {
  job_with_rig(store_, id);
  const std::lock_guard<std::mutex> turn(computing_);
  Json findings = Json::array();
  const std::string file = latest_rig(store_, id);
  for (const engine::Finding& finding : engine::lint(*asset_of(id, file))) {
    findings.push_back({{"code", finding.code},
                        {"severity", finding.severity},
                        {"sentence", finding.sentence},
                        {"count", finding.count},
                        {"share", finding.share},
                        {"place_kind", finding.place_kind},
                        {"place", finding.place}});
  }
  return reply_of({{"file", file}, {"findings", findings}});
}

Reply Api::compare(const std::string& id, const std::string& body) {
  const JobRecord record = job_with_rig(store_, id);
  const Json request = request_json(body);
  ConfigReader reader(request, "request");
  const std::vector<std::string> methods = reader.texts("methods", {"curve", "pinocchio", "heat"});
  reader.finish();
  if (methods.empty() || methods.size() > kMostMethods)
    throw reader.error("methods", "names none or more than " + std::to_string(kMostMethods));
  std::vector<JobRecord> wanted;
  for (const std::string& method : methods) {
    JobRecord other;
    other.kind = "rig";
    other.name = fs::path(record.name).stem().string() + "." + method + ".glb";
    other.group = record.group.empty() ? record.id : record.group;
    other.options = {{"method", method}, {"keep_skeleton", false}};
    parse_job_options(other.options, other.kind);
    other.names["file"] = other.name;
    other.source = record.id;
    wanted.push_back(std::move(other));
  }
  const std::string mesh = read_file(store_.folder(id) / latest_rig(store_, id));
  Json jobs = Json::array();
  for (const JobRecord& other : wanted) {
    const std::optional<JobRecord> accepted = runner_.submit(other, {{"file", ".glb", mesh}});
    if (accepted) jobs.push_back(described(*accepted));
  }
  if (jobs.empty()) throw RequestError(429, "too many jobs wait; try again when one has ended");
  return reply_of({{"jobs", jobs}}, 201);
}

}  // namespace anigen::studio
