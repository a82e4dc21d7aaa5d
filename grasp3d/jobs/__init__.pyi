from .cluster_settings import ClusterSettings as ClusterSettings
