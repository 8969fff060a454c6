#pragma once

namespace palpate {

/// How a live model is made (docs/live.md).
struct LiveSettings {
  int modes = 12;            ///< r, at most LiveSize::kToolModes
  int partner_modes = 6;     ///< of each body that the tool touches; of all at most LiveSize::kPartnerModes
  int contacts = 16;         ///< at most LiveSize::kContacts
  int second_order = 0;      ///< q, at most LiveSize::kSecond
  double horizon = 0.033;    ///< H is this or the visual step, whichever is longer [s]
  double margin = 0.005;     ///< what is nearer than this, or will be, becomes a contact [m]
  double lookahead = 0.066;  ///< for that long as it now moves [s]
  double feedback = 1.0;     ///< most that the replayed modes count for, against the coarse step's
  /// A visual step in which nodes leave straight lines by more than this share of the tool's diagonal is taken in
  /// parts; 0: never.
  double bend = 0.004;
};

}  // namespace palpate
