"""Pictures of an arm, without a graphics driver."""
