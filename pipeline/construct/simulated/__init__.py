"""What a camera, a depth camera and structure from motion would have kept of a generated scene."""
