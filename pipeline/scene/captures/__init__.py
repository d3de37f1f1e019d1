"""Camera files: each loader converts to OpenCV world-to-camera poses at the door."""
