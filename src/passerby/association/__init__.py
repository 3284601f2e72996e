"""From detections and tracklets to who is who over all cameras: by appearance, by ground tracks, or by both."""
