#pragma once
/// Anymate, a learned rigger: its modules, its data, its denoisers for joints.
#include "anigen/anymate/blocks.h"
#include "anigen/anymate/dataset.h"
#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/model.h"
#include "anigen/anymate/point_encoders.h"
#include "anigen/anymate/style.h"
#include "anigen/anymate/volumes.h"
