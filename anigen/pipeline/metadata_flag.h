#pragma once
#include <filesystem>
#include <set>
#include <string>

#include "anigen/core/file_lock.h"

namespace anigen::pipeline {

/// Keeps anigen-prepare from writing the tables of a dataset as long as the lock is held. Does not keep out others that
/// hold it. @throws InputError when there is no metadata.csv, or anigen-prepare is at work there
FileLock share_dataset(const std::filesystem::path& root);

/// Sets a boolean column of a dataset's metadata.csv: True for these ids, False for all others; everything else in the
/// table stays as it is. A column that is not there is added. Written atomically, and only if something changes. Safe
/// beside other programs that change the table: they lock the same files, run/lock and run/lock-metadata.
/// @param root folder of metadata.csv @throws InputError when the table cannot be read or has no ids, or as
/// share_dataset(); Interrupted while another program keeps the table locked
void set_metadata_flag(const std::filesystem::path& root, const std::string& column, const std::set<std::string>& ids);

}  // namespace anigen::pipeline
