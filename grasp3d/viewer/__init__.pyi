from .view_settings import ViewSettings as ViewSettings
