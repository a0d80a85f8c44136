#pragma once
#include <filesystem>
#include <functional>
#include <optional>

#include "anigen/core/file_lock.h"

namespace anigen {

/// Waits until it has the lock. For locks that nobody holds for long. @throws Interrupted after Ctrl-C
FileLock wait_for_lock(const std::filesystem::path& file, FileLock::Kind kind);

/// Makes this process one of those that work on the same thing, as long as the lock lives. Who joins passes a gate one
/// at a time (`<file>-gate`), so that there is exactly one first.
/// @param file that all members hold together
/// @param enter is called in the gate, before this process is a member; `first` when there is no other one. What it
/// throws keeps this process out
/// @return nothing when somebody has the place to itself
std::optional<FileLock> join_group(const std::filesystem::path& file, const std::function<void(bool first)>& enter);

/// Has the place of a group to itself, as long as the lock lives. @return nothing while the group has members
std::optional<FileLock> instead_of_group(const std::filesystem::path& file);

/// Calls `action` in the gate, so that nobody joins meanwhile. @return false, without calling it, when there are
/// members
bool while_group_is_empty(const std::filesystem::path& file, const std::function<void()>& action);

}  // namespace anigen
