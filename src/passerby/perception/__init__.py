"""From videos to observations: decoding, detection, embedding, keypoints, and the model files that they use."""
