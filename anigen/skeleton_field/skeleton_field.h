#pragma once
/// The skeleton field (paper 3.2): residuals to joint and parent, confidence-weighted votes, Algorithm 1, repair of
/// the tree.
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/loss.h"
#include "anigen/skeleton_field/skeleton_repair.h"
#include "anigen/skeleton_field/voting.h"
