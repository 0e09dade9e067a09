"""Follows the carts in the bays of a yard, from how sure a detector is of each bay in each picture."""

import numpy as np
import supervision as sv

SIDE, BAYS = 64.0, 12
BOXES = [(100.0 * (k % 4), 100.0 * (k // 4), 100.0 * (k % 4) + SIDE, 100.0 * (k // 4) + SIDE) for k in range(BAYS)]


def node(publish, checked):
    tracker = sv.ByteTrack(track_activation_threshold=0.25, lost_track_buffer=5, frame_rate=30)

    def picture(m):
        seen = [(box, sure) for box, sure in zip(BOXES, m["sure"], strict=False) if 0 <= sure <= 1]
        found = tracker.update_with_detections(
            sv.Detections(
                xyxy=np.array([box for box, _ in seen]).reshape(-1, 4),
                confidence=np.array([sure for _, sure in seen], dtype=float),
                class_id=np.zeros(len(seen), dtype=int),
            )
        )
        publish(
            "bays",
            {
                "carts": len(found),
                "lost": len(tracker.lost_tracks),
                "removed": len(tracker.removed_tracks),
                "light": m["light"],
            },
        )

    return {"picture": picture}
